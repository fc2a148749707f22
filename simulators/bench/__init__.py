"""The bench put together: one world, its devices, a body that drops RAW files, an operator's hands, and faults."""
