"""Initial depth: Algorithms II and III, matching, registration and segmentation."""
