"""Stages of TMCL modules: the manufacturer's library (pytrinamic) encodes datagrams, a Transport carries them."""
