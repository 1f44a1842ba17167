"""Reproduces the paper's figures: jobs, their results, claims, plots and an HTML report.

study           the interface of a study: its jobs at a problem size, what each computes, the analysis of results
hologram_study  the job that most studies share (optimise a hologram and measure it), and gains beside the paper's
charts          charts that studies share
runner          runs jobs in this process, in several, or on a Dask cluster, and keeps their results
report          the report as HTML, CSV and figures
hologram_report one or some holograms reviewed, as a page that prints to two sheets, and as JSON
claims          claims on numbers, and their verdicts
hologram_sheets the two sheets of that page as blocks of `sheet_fit`
sheet_fit       how much a part of a page must shrink to fit on a sheet of paper
display_contrast  sequential and checkerboard contrast of a bench
demonstration   two displays rendered, scored and shown beside the target, for `holoview demo`
studies         the studies, by question
"""
