"""Pages of many photographs together: a batch, and a series of one lens."""
