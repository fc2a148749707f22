"""How things are drawn, for pages and for terminals: style, pictures, curves in characters. Knows no result folder."""
