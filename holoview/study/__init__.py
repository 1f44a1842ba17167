"""Reproduces the paper's figures: jobs, their results, claims, plots and an HTML report.

study               the interface of a study: its jobs, what each computes, and the analysis of the results
hologram_jobs       the job that most studies share (optimise a hologram and measure it), and means over results
hologram_study      base classes of studies that compare optimised holograms
claims              a measured gain compared with the paper's, and the verdict in words
scale               problem sizes: quick, middle, full
store               results as JSON and PNG files, so that a repeated run continues
runner              runs jobs in this process, in several, or on a Dask cluster, with retries
executors           worker processes and Dask workers, each with its share of the machine
plots               charts that studies share
perceptual_columns  FLIP, ColorVideoVDP and MS-SSIM in the tables of a study
speckle_figure      a region of speckle with its histogram
report              the report as HTML, CSV and figures
registry            finds the studies
studies             the studies, one in each file
"""
