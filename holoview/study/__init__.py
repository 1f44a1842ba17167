"""Studies: a figure, the numbers behind it and the settings that made it, by one command.

study            what a study is: jobs, their work, what is found
work             jobs that several studies share: an optimised hologram and its scores; speckle of random patterns
scale            how large: quick, full
store runner     results kept as they come; jobs run here, in processes, or on a cluster
plots report     figures; the report as one HTML file, and its raw numbers
registry         the studies that there are, a file each in `studies/`
"""
