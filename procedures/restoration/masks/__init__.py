"""What blurs: masks of every depth from lens, motion or measurement, and the operator that spreads light over them."""
