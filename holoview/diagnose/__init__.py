"""What a simulation gets wrong about a real bench: from captures to named causes, an extended model, and its gain.

The algorithm, in the order in which it is read:

pipeline            runs a diagnosis: correct, search, refine, judge, report
config              what callers set, and how predictions sample light

record_errors       correct: wrong records as causes, put right before the search
bad_captures        captures that were left out; those that are dark, saturated or given twice
search_context      what all stages of a search share, and when it ends
capture_split       which captures are searched, fitted and held out
single_capture      blocks of a single picture held out
crop                the middle of large pictures, which is searched first
worker_pool         jobs in several processes
calibration_prior   known effects that were measured, corrected within their uncertainties

likelihood          residuals of a prediction, gains and movements of the camera fitted: what everything compares
search              search: one cause after another
screening           first look at every effect, and what its predictions cost
starts              starting values that the pictures suggest
fit                 local fits, scans of a range, and what improves a fit
refine              refine: joint fits of several causes, polished near the noise floor; the simplest name
judge               judge: candidates ranked on held-out captures, and the verdict
nuisances           sensitivity of pixels, movements of the camera, drift of lasers, sampling of the model
outlier_rejection   a search among the captures that are good
capture_judgement   every capture judged by a model
capture_outliers    which captures stand out from the others
capture_reasons     why a capture isn't what its record says

diagnosis           report: the result and its JSON
cause_description   causes as they are reported
uncertainty         confidence intervals; correlations between effects
confounders         look-alikes, and the capture that separates them
power_law           what the gains tell of the lasers' power
free_maps           where an error lives that no effect explains
pixel_maps          which pixels, columns and rows of a modulator stand out
excess_breakdown    χ²/n by property of the pixels
fit_statistics      PSNR and explained variance of held-out captures
formatting          values with their intervals as text
suggestions         what to do next
extended_model      a bench with the causes switched on
display_gain        what the extended model gains on the display
plots               figures
html_report         the report
"""
