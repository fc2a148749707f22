"""Where charts are in a photograph: saddle points, x-corners, their layout, and the frame they must lie on."""
