"""Devices of microscopes and labs through Micro-Manager's core, which has some two hundred adapters for them.

Optional (extra `micromanager`). `core` alone imports pymmcore. Which devices there are is said by a configuration file
that Micro-Manager's own hardware wizard writes; station.toml says what they mean here.
"""
