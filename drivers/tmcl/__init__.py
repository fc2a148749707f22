"""Stages of TMCL modules: the maker's library (pytrinamic) makes and reads the datagrams, our own line carries them."""
