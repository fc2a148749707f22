"""Masks of a motion that nobody recorded, from the photographs themselves (blind)."""
