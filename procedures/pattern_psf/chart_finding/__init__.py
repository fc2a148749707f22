"""Detection of charts in a photograph: saddle points, x-corners, their layout, and verification by the frame."""
