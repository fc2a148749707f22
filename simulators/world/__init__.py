"""The simulated scene in space and time: bodies, sheets and light, without camera or cables."""
