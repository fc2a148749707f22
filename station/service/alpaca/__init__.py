"""The bench as ASCOM Alpaca devices (interface version 1 of the protocol, device interfaces of Platform 7)."""
