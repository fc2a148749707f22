"""The depth to begin with: Algorithms II and III, the matched start, registration and segments."""
