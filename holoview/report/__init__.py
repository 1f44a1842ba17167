"""Images that combine several pictures with captions.

contact_sheet  a grid of pictures with a title over each column and a caption under each picture
"""
