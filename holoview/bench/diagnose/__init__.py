"""Names the differences of a real bench from its simulation: from captures to named causes and an extended model.

The algorithm, in reading order:

pipeline            runs a diagnosis: correct, search, refine, judge, report
steps               which search follows which, in which pictures: tables, and the loop over them
config              what callers set, and how predictions sample light

correct             correct: wrong records put right; captures that don't fit their records
search_context      what all stages of a search share, and when it ends
capture_split       which captures are searched, fitted and held out
single_capture      blocks of a single picture held out
crop                the middle of large pictures, which is searched first
worker_pool         jobs in several processes
calibration_prior   known effects that were measured, corrected within their uncertainties

likelihood          residuals of a prediction, with gains and movements of the camera fitted; all comparisons use them
search              search: one cause after another
screening           first look at every effect, and what its predictions cost
starts              starting values that the pictures suggest
fit                 local fits, scans of a range, and what improves a fit
refine              refine: joint fits of several causes, polished near the noise floor
judge               judge: candidates ranked on held-out captures, and the verdict
rivals              the simplest of equal names; look-alikes that these captures can't exclude
speckle_evidence    when the light on the modulator is sought by speckle, and in which part of the pictures
speckle_search      that search: where it starts, and which parts of the light it needs
speckle_light       the light that it varies, and how well the speckle stands with it
sampling_choice     whether camera pixels integrate, how fine predictions have to be
detail_veto         no cause that takes away detail which the pictures show
nuisances           sensitivity of pixels, movements of the camera, drift of lasers, sampling of the model
outlier_rejection   a search without the bad captures
intervals           confidence intervals, values as text; correlations between effects
fit_statistics      χ²/n, PSNR and explained variance of held-out captures; which pixels hold the excess
power_law           laws of the lasers' power, read off the gains

report              report: the result and its JSON, causes in words, where an error lives, figures
extended_model      a bench with the causes switched on
"""
