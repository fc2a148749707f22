"""Live focus: photographs as they come, and what they tell."""
