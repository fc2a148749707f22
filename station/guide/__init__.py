"""Runs a plan: asks, moves, settles, exposes, checks, and keeps what counts."""
