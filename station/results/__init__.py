"""Result folders: records, numbers, exports, limits, and whether they are still what was written."""
