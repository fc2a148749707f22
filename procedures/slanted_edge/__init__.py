"""MTF across slanted edges between two uniform areas (ISO 12233:2023, e-SFR).

`find` detects edges, `edge_line` estimates their course, `profile` and `transfer` edge spread function and MTF with the
uncertainty by noise, `evidence` and `corruptions` what processing, print and motion add, `trust` the verdict;
`estimate` combines them.
"""
