"""The viewer: a document, its images, and the window, browser or page that shows them.

page        a hologram as a web page
render      images of a document, kept up to date
document    the document that a viewer edits: undo, background jobs, files, a rig beside it
app         the window and its panels; `show` in a notebook
"""
