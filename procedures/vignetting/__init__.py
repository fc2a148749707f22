"""Light that a lens and sensor lose towards the corners, by plane, from photographs of even light (flats).

`cells` makes means of small parts of a plane, `surface` lays a smooth surface through those of all flats at once and a
radial formula beside it, `estimate` says what both mean. Imports what the rooms share.
"""
