"""Files of cameras that deliver pixels: DNGs, and the folder that holds them."""
