"""What there is: bodies in space and time, sheets and light. Knows no camera and no cable."""
