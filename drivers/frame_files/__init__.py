"""Files of cameras that give pixels: DNGs, and the folder that they are kept in."""
