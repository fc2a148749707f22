"""Devices of microscopes and laboratories through Micro-Manager's core and its roughly two hundred adapters.

Optional (extra `micromanager`). Only `core` imports pymmcore. The devices are listed in a configuration file
written by Micro-Manager's hardware wizard; station.toml assigns their functions.
"""
