"""Records that are put right before a search, and captures that are left out of it.

wrong_records    finds wrong records, puts them right, and states how much each correction gains
bad_captures     captures that are dark, saturated or given twice; tests of which captures stand out from the others
judged_captures  every capture judged by a model, and why it doesn't fit its record
"""
