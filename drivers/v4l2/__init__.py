"""Cameras of Linux' video interface, V4L2: UVC cameras, frame grabbers, sensors of single-board computers."""
