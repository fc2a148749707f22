"""Noise amplification gamma: of a photograph, as a function of s/t, and its explanation for the operator."""
