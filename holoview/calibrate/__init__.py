"""Calibration: learns corrections to a bench's model from camera captures.

From a diffraction-efficiency sweep of one modulator:

efficiency_sweep  reads the sweep from a CSV file
lut               fits a monotone phase look-up table to it, with the stroke's 95 % interval
lut_file          writes the table as TOML, puts it into a bench, formats it for people

From captures of a whole bench (the maps themselves are `holoview.model.effects.learned_maps`):

exposure          plans laser power and exposure time of the captures
data_split        splits captures into training, validation, and unseen planes and wavelengths
training_data     camera images with inverse-variance weights
map_layout        chooses which maps the captures can determine, and their resolution
forward_model     predicts camera images from maps, with gradients; prior of the maps
settings          settings of the training, and learning rates
train             trains the maps with Adam
checkpoint        saves and restores the state of the training
laser_response    fits each laser's scale and power-law exponent
prediction_score  scores predictions before and after
result            writes the preset, its maps and the scores
map_plots         plots the maps and the residuals
lut_plot          plots a look-up table
"""
