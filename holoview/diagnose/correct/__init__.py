"""What is put right before a search, or left out of it: wrong records, and captures that aren't what their records say.

wrong_records    finds wrong records, puts them right, and states how much each correction gains
bad_captures     captures that are dark, saturated or given twice; tests of which captures stand out from the others
judged_captures  every capture judged by a model, and why it isn't what its record says
"""
