"""Images for people: pictures with captions, and figures.

contact_sheet  a grid of pictures with a title over each column and a caption under each picture
figure         matplotlib figures without a window, and whether matplotlib is installed
"""
