"""The bench over HTTP: sessions and results, runs, live journals, Alpaca, a page for phones."""
