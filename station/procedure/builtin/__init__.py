"""The procedures of this program: one object a module."""
