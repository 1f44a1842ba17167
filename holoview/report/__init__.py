"""Images for people.

images  contact sheets, and matplotlib figures without a window
"""
