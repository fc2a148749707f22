"""The bench for other programs, over HTTP: sessions and results, runs, growing journals, Alpaca, a phone's page."""
