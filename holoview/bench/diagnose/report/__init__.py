"""The report of a diagnosis once its search has ended; `assemble.assemble` makes it.

assemble      puts the diagnosis together
diagnosis     the result, and its JSON
causes        the causes: values, intervals, share explained, look-alikes, the capture that separates rivals
error_places  where an error lives that no effect explains: free maps, pixel maps, what to do about it
html_report   the report with its figures
display_gain  what the extended model gains on the display
"""
