"""The method from end to end: the paper's, fast, fine, the bound Deformer, components, transfer."""
