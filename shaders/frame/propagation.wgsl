// Transfer function × pupil of a relay, at the frequencies of one column.
//#include "lib/transfer.wgsl"
//#include "lib/grid.wgsl"

override has_pupil: bool = false;

@group(1) @binding(3) var<storage, read> propagations: array<Propagation>;
// Smallest |k_y|, lowest and highest k_y that pass, for each k_x of each wavelength.
@group(1) @binding(4) var<storage, read> support: array<vec4i>;
@group(1) @binding(5) var<storage, read> pupil: array<vec2f>;

var<private> propagation: Propagation;
var<private> column: ColumnTerms;
var<private> column_support: vec4i;
var<private> pupil_column: u32;

fn begin_column(kx: i32, field: u32) {
    let index = frequency_index(kx, grid.padded.y);
    propagation = propagations[params.first_wavelength + field];
    column = column_terms(propagation, kx);
    column_support = support[(params.first_wavelength + field) * grid.padded.y + index];
    pupil_column = field * grid.padded.x * grid.padded.y + index;
}

// A value of the spectrum at k_y behind the relay; 0 if the relay stops that frequency.
fn propagated(ky: i32, value: vec2f) -> vec2f {
    let mask = select(0.0, inverse_scale, is_in_support(column_support, ky));
    var behind = cmul(value, transfer(propagation, column, ky)) * mask;
    if (has_pupil) {
        behind = cmul(behind, pupil[pupil_column + frequency_index(ky, grid.padded.x) * grid.padded.y]);
    }
    return behind;
}
