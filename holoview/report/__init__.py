"""Images for people: contact sheets and figures.

images  contact sheets, and matplotlib figures without a window
"""
