// What a window shows of one or two images of XYZ: zoomed, exposed, through the sRGB curve or a palette, side against
// side. A pixel smaller than a sample shows the nearest one; a larger one shows the mean light of what it covers.
// Twin: holoview/session/tone_mapping.py, pixels.

@group(0) @binding(0) var<uniform> show: Viewport;

@group(1) @binding(0) var<storage, read> image_a: array<vec4f>;
@group(1) @binding(1) var<storage, read> image_b: array<vec4f>;
@group(1) @binding(2) var<storage, read> palette: array<u32>;  // 256 colours
@group(1) @binding(3) var target_texture: texture_storage_2d<rgba8unorm, write>;

// What decides between ways to go is constant: lavapipe compiles a shader anew for every submission whose branches
// depend on a uniform.
override comparison: u32 = 0u;  // ONE, WIPE, SIDES or DIFFERENCE
override only_b: bool = false;  // the one side is b
override has_palette: bool = false;
override is_linear: bool = false;  // the palette is read by the value itself, not by its code
override has_gamma: bool = false;
override has_grid: bool = false;
override taps: i32 = 1;  // samples along an axis that a pixel may cover
override is_sparse: bool = false;  // it covers more, of which so many are taken

const ONE = 0u;
const WIPE = 1u;
const SIDES = 2u;
const DIFFERENCE = 3u;

fn srgb_encoded(linear: vec3f) -> vec3f {
    let curve = 1.055 * pow(max(linear, vec3f(0.0031308)), vec3f(1.0 / 2.4)) - 0.055;
    return select(curve, 12.92 * linear, linear <= vec3f(0.0031308));
}

fn sample_at(is_b: bool, place: vec2i, size: vec2i) -> vec3f {
    let held = clamp(place, vec2i(0), size - 1);
    let index = held.y * size.x + held.x;
    if (is_b) {
        return image_b[index].xyz;
    }
    return image_a[index].xyz;
}

/// Mean XYZ over the footprint of a pixel, whose corners are `low` and `high` in samples: each sample by the share of
/// its area that is covered, else the samples' own pattern would beat with the pixels'.
fn light(is_b: bool, low: vec2f, high: vec2f, size: vec2i) -> vec3f {
    if (taps == 1) {
        return sample_at(is_b, vec2i(floor(0.5 * (low + high))), size);
    }
    var sum = vec3f(0.0);
    if (is_sparse) {
        for (var y = 0; y < taps; y++) {
            for (var x = 0; x < taps; x++) {
                let share = (vec2f(f32(x), f32(y)) + 0.5) / f32(taps);
                sum += sample_at(is_b, vec2i(floor(mix(low, high, share))), size);
            }
        }
        return sum / f32(taps * taps);
    }
    let first = vec2i(floor(low));
    for (var y = first.y; y < first.y + taps; y++) {
        let height = max(min(high.y, f32(y + 1)) - max(low.y, f32(y)), 0.0);
        for (var x = first.x; x < first.x + taps; x++) {
            let width = max(min(high.x, f32(x + 1)) - max(low.x, f32(x)), 0.0);
            sum += width * height * sample_at(is_b, vec2i(x, y), size);
        }
    }
    return sum / ((high.x - low.x) * (high.y - low.y));
}

/// Exposed channels of a side at a place of the image, 0 black to 1 white.
fn channels(is_b: bool, place: vec2f) -> vec3f {
    let size = vec2f(select(show.size_a, show.size_b, is_b));
    let half_step = 0.5 * show.step;
    let gain = select(show.gain_a, show.gain_b, is_b);
    let xyz = gain * light(is_b, (place - half_step) * size, (place + half_step) * size, vec2i(size));
    return vec3f(
        dot(show.first.xyz, xyz) + show.first.w,
        dot(show.second.xyz, xyz) + show.second.w,
        dot(show.third.xyz, xyz) + show.third.w,
    );
}

fn coded(value: vec3f) -> vec3f {
    let code = srgb_encoded(clamp(value, vec3f(0.0), vec3f(1.0)));
    if (has_gamma) {
        return pow(code, vec3f(1.0 / show.gamma));
    }
    return code;
}

fn through_palette(code: f32) -> vec3f {
    return unpack4x8unorm(palette[u32(round(255.0 * clamp(code, 0.0, 1.0)))]).rgb;
}

fn colour(is_b: bool, place: vec2f) -> vec3f {
    if (comparison == DIFFERENCE) {
        let difference = channels(false, place) - channels(true, place);
        if (has_palette) {
            return through_palette(0.5 + 0.5 * difference.x);
        }
        return coded(abs(difference));
    }
    let value = channels(is_b, place);
    if (!has_palette) {
        return coded(value);
    }
    if (is_linear) {
        return through_palette(value.x);
    }
    return through_palette(coded(value).x);
}

/// Whether the edge between two samples passes through this pixel.
fn on_grid(place: vec2f) -> bool {
    let size = vec2f(show.size_a);
    return any(floor(place * size) != floor((place - show.step) * size));
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3u) {
    if (any(id.xy >= show.size)) {
        return;
    }
    let half_width = show.size.x / 2u;
    let is_right = comparison == SIDES && id.x >= half_width;
    let pixel = vec2f(f32(select(id.x, id.x - half_width, is_right)), f32(id.y)) + 0.5;
    let place = show.origin + pixel * show.step;
    let is_b = is_right || (comparison == WIPE && f32(id.x) >= show.split) || (comparison == ONE && only_b);
    var shown = show.background.rgb;
    if (all(place >= vec2f(0.0)) && all(place < vec2f(1.0))) {
        shown = colour(is_b, place);
        if (has_grid && on_grid(place)) {
            shown = mix(shown, vec3f(0.5), 0.35);
        }
    }
    let is_seam = (comparison == SIDES && id.x == half_width) || (comparison == WIPE && abs(f32(id.x) + 0.5 - show.split) < 1.0);
    if (is_seam) {
        shown = vec3f(0.95);
    }
    textureStore(target_texture, vec2i(id.xy), vec4f(shown, 1.0));
}
