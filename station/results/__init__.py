"""Result folders: records, numbers, exports, limits, integrity."""
