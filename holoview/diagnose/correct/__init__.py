"""What is put right before a search, and left out of it: wrong records, and captures that aren't what these say.

bad_captures     captures that are dark, saturated or copies, and those that stand out from the others
"""
