// What a region of an image measures: the twins of holoview/holograms/metrics/speckle.py and psnr.py. Regions are samples
// {x, y, width, height}; images are XYZ, Float32Array (y, x, 4).

// Linear sRGB (3) of XYZ, not clipped.
const linearRgb = (matrix, x, y, z) => matrix.map(row => row[0] * x + row[1] * y + row[2] * z)

const srgbDecode = code => (code <= 0.04045 ? code / 12.92 : ((code + 0.055) / 1.055) ** 2.4)
const DECODED = Float64Array.from({ length: 256 }, (_, code) => srgbDecode(code / 255))

// Mean, standard deviation and contrast σ/μ of the luminance in a region, with a histogram of
// Y/mean in 32 bins of 1/8, the last of which takes all that is brighter.
function speckle(xyz, width, region) {
    const values = new Float64Array(region.width * region.height)
    let at = 0
    for (let y = region.y; y < region.y + region.height; y++) {
        for (let x = region.x; x < region.x + region.width; x++) values[at++] = xyz[4 * (y * width + x) + 1]
    }
    let sum = 0
    for (const value of values) sum += value
    const mean = sum / values.length
    let squares = 0
    const histogram = new Array(32).fill(0)
    for (const value of values) {
        squares += (value - mean) * (value - mean)
        histogram[Math.min(Math.floor((value / mean) * 8), 31)] += 1
    }
    const std = Math.sqrt(squares / values.length)
    return { mean, std, contrast: std / mean, samples: values.length, histogram }
}

// PSNR in dB, peak 1, of linear sRGB clipped to 0…1 against a target of 8-bit sRGB codes (y, x, 4).
function psnr(xyz, target, width, region, matrix) {
    let squares = 0
    const clip = value => Math.min(Math.max(value, 0), 1)
    for (let y = region.y; y < region.y + region.height; y++) {
        for (let x = region.x; x < region.x + region.width; x++) {
            const i = 4 * (y * width + x)
            const rgb = linearRgb(matrix, xyz[i], xyz[i + 1], xyz[i + 2])
            for (let c = 0; c < 3; c++) squares += (clip(rgb[c]) - DECODED[target[i + c]]) ** 2
        }
    }
    return -10 * Math.log10(squares / (3 * region.width * region.height))
}
