"""What a simulation gets wrong about a real bench: from captures to named causes, an extended model, and its gain.

pipeline            runs a diagnosis: prepare, search, decide, assemble
config              all settings of a diagnosis, with units and evidence
sampling_config     how predictions sample light
diagnosis           the result and its JSON

search_preparation  what a search works with, from captures
search_context      what all stages share: captures, bench, effects, predictors, workers, settings
worker_pool         jobs in several processes
shared_arrays       objects for several processes whose large arrays exist once
record_errors       wrong records as causes, put right before the search
bad_captures        captures that were left out; those that are dark, saturated or given twice
capture_outliers    which captures stand out from the others
capture_judgement   every capture judged by a model
capture_reasons     why a capture isn't what its record says
judged_search       a search among the captures that are good
region_search       large pictures: their middle is searched, whole ones judge
picture_limit       pictures that are cut because of their size
picture_middle      the middle of large pictures, which is searched first
one_picture         blocks of a single picture held out
capture_split       which captures are searched, fitted and held out
comparison          residuals of a prediction, gains and movements of the camera fitted
free_parameters     parameters of effects as one vector
field_count         how many fields a prediction adds, which is what it costs

screening           first look at every effect
displacement_starts starting values where the image has moved
ghost_starts        starting values where a copy lies over the image
smear_starts        starting values where the image is smeared along a line
fringe_starts       starting values where plane fringes lie over the image
modulator_fringe_starts  the same where they lie over a modulator
fringe_spectrum     fringes as peaks of a spectrum that all wavelengths share
stuck_starts        starting values where columns, rows or pixels of a modulator are stuck
plane_starts        starting values where planes are off, each by its own error
dead_places         columns, rows, parts of them and pixels that are stuck
replacement_gains   what pixels of a modulator would gain if they showed one level, by an adjoint pass
transmission_slopes that adjoint pass: derivatives by the transmission of every pixel
effect_scan         scans of one effect's range
effect_fit          local least-squares fits
fit_improvements    longer steps, hard edges, axes, fewer parameters
refine              joint fits of several causes
polishing           the best candidates polished near the floor
last_fit            the best ones fitted until nothing is gained
held_out_ranking    candidates ranked on captures that no fit has used
forward_selection   one cause after another

nuisances           sensitivity of pixels, movements of the camera, drift of lasers
laser_drift         wavelengths that drift between captures
significance        whether a mean differs from zero
simplest_name       the effect of fewest numbers among those that are the same physics
sampling_check      whether other samples explain what a cause explains
power_law           what the gains tell of the lasers' power
verdict             what the figures allow one to say

cause_description   causes as they are reported
uncertainty         confidence intervals; correlations between effects
confounders         look-alikes, and the capture that separates them
free_maps           where an error lives that no effect explains
pixel_maps          which pixels, columns and rows of a modulator stand out
excess_breakdown    χ²/n by property of the pixels
fit_statistics      PSNR and explained variance of held-out captures
formatting          values with their intervals as text
extended_model      a bench with the causes switched on
display_gain        what the extended model gains on the display
plots               figures
html_report         the report
"""
