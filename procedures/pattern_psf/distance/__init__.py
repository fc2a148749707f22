"""Distance of the chart by laser, rail and its size in the image, and contradictions between them."""
