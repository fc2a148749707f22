"""What is on the other end of a wire: one device per file, behind small interfaces.

Knows neither the procedures nor the simulators that stand in for its devices. `interfaces` says what each kind of
device promises, `errors` what can go wrong, `transport` owns the serial line and alone imports `serial`.

A new device is a parser (pure bytes to events), a class with the methods of its interface over a `Transport`, a twin
of the same stem in `simulators.devices`, one line in `station/bench/device_makers.py`, and one in
`tests/conformance/conftest.py`: the promises of its kind are then tested by themselves. What other people's libraries
drive (`gphoto`, `micromanager`) stands on these, and is tested with devices that come with them.
"""
