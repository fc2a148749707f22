"""Drawing for pages and terminals: style, pictures, curves in characters. Independent of result folders."""
