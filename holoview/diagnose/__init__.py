"""What a simulation gets wrong about a real bench: from captures to named causes, an extended model, and its gain.

The algorithm, in the order in which it is read:

pipeline            runs a diagnosis: correct, search, refine, judge, report
config              what callers set, and how predictions sample light

correct             correct: wrong records put right; captures that aren't what their records say
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
refine              refine: joint fits of several causes, polished near the noise floor
judge               judge: candidates ranked on held-out captures, and the verdict
rivals              the simplest of equal names; look-alikes that these captures can't exclude
nuisances           sensitivity of pixels, movements of the camera, drift of lasers, sampling of the model
outlier_rejection   a search among the captures that are good
intervals           confidence intervals, values as text; correlations between effects
fit_statistics      χ²/n, PSNR and explained variance of held-out captures; which pixels hold the excess
power_law           what the gains tell of the lasers' power

report              report: the result and its JSON, causes in words, where an error lives, figures
extended_model      a bench with the causes switched on
"""
