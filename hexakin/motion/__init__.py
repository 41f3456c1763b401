"""Records of motion that producers make and consumers read: recordings, plans, motions, and measures of them."""
