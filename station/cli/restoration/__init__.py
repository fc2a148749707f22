"""What `station restore` is told besides its photographs: of the blur, and of the camera."""
