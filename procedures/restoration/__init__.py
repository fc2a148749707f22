"""Two or more photographs, blurred by depth: one sharp picture and the depth map (Sorel 2007)."""
