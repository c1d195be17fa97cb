"""Times of methods on a machine that does nothing else, and the tables made from them."""
