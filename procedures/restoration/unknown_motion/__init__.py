"""Masks of unrecorded motion, estimated from the photographs themselves (blind)."""
