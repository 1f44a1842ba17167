"""What a diagnosis tells once the search has ended.

diagnosis     the result, and its JSON
free_maps     where an error lives that no effect explains: smooth maps, and what to do about it
html_report   the report with its figures
display_gain  what the extended model gains on the display
"""
