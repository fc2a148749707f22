"""Drivers: one device per file, behind small interfaces.

Drivers import neither the procedures nor the simulators. `interfaces` states what each kind of device promises,
`errors` lists what can fail, `transport` owns the serial line and alone imports `serial`.

A new device is a parser (pure bytes to events), a class with the methods of its interface over a `Transport` (mostly
a `LineDevice` of `wire.connection`), a model of its options beside it (`making`, `options`), a simulator of the same
stem, one line in `station/bench/device_models.py`, and one in `tests/conformance/conftest.py`, which tests the
promises of its kind. A simulator stands in `simulators.devices` if `station` uses it, otherwise with the tests.
Devices of third-party libraries (`gphoto`, `micromanager`) use these libraries instead of a transport, and are tested
with the simulated devices shipped with them.
"""
