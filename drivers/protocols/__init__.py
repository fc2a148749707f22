"""What devices say and are told, as bytes and as values: no port is opened here."""
