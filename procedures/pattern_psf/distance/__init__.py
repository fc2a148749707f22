"""What laser, rail and the chart's size say of the distance, and what contradicts what."""
