"""Devices of other programs behind ASCOM Alpaca: focusers as axes, cameras, switches as lamp and shutter."""
