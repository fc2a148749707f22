"""The sensor's plane against the surface of best focus, from a focus bracket: its tilt, and the screws that mend it.

Verb: `estimate`. The bracket's PSFs are `procedures.field`'s; the plane through what they say is `plane`, the screws
that mend it are `screws`; `plan` guides through measuring and turning.
"""
