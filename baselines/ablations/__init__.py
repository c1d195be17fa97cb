"""The method `paper` and transfers with a part replaced, and the frames that they can take."""
