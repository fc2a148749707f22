"""The slanted edge: MTF across straight edges between two plain areas, the cross-check that everyone knows.

`estimate` is the verb: `find` looks for edges, `course` says where one runs, `profile` and `transfer` give its spread
function and MTF, `resampling` the uncertainty, `trust` the verdict. ISO 12233:2023, e-SFR.
"""
