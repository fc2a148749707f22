"""Tilt of the sensor relative to the surface of best focus, from a focus bracket, and its correction by screws.

`estimate` combines the bracket's PSFs (`procedures.field`), the plane (`plane`) and the turns of the screws (`screws`);
`plan` guides through measurement and correction.
"""
