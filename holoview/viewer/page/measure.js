// What a region of an image measures: the twins of holoview/holograms/metrics/speckle.py and psnr.py. Regions are samples
// {x, y, width, height}; images are XYZ, Float32Array (y, x, 4).

// Linear sRGB (3) of XYZ, not clipped.
const linearRgb = (matrix, x, y, z) => matrix.map(row => row[0] * x + row[1] * y + row[2] * z)

const srgbDecode = code => (code <= 0.04045 ? code / 12.92 : ((code + 0.055) / 1.055) ** 2.4)
const DECODED = Float64Array.from({ length: 256 }, (_, code) => srgbDecode(code / 255))

const TARGET_FLOOR = 0.05 // of a target's mean in the region, below which its samples don't count

// Luminance Y of a region, divided by that of a target of 8-bit sRGB codes (y, x, 4) where one is given and has light:
// Y/(g·T) where T is at least TARGET_FLOOR of its mean, g = ΣY/ΣT there. luminance: row of the matrix sRGB to XYZ.
function structureFree(xyz, width, region, target, luminance) {
    const values = [], wanted = []
    for (let y = region.y; y < region.y + region.height; y++) {
        for (let x = region.x; x < region.x + region.width; x++) {
            const i = 4 * (y * width + x)
            values.push(xyz[i + 1])
            if (target) wanted.push(luminance.reduce((sum, weight, c) => sum + weight * DECODED[target[i + c]], 0))
        }
    }
    const total = of => of.reduce((sum, value) => sum + value, 0)
    if (!target || total(wanted) === 0) return { values: Float64Array.from(values), divided: false }
    const floor = (TARGET_FLOOR * total(wanted)) / wanted.length
    const kept = wanted.map(value => value > 0 && value >= floor)
    const gain = total(values.filter((_, k) => kept[k])) / total(wanted.filter((_, k) => kept[k]))
    return { values: Float64Array.from(values.map((value, k) => value / (gain * wanted[k])).filter((_, k) => kept[k])), divided: true, wanted }
}

// Mean and standard deviation of numbers.
function moments(values) {
    const mean = values.reduce((sum, value) => sum + value, 0) / values.length
    const squares = values.reduce((sum, value) => sum + (value - mean) * (value - mean), 0)
    return { mean, std: Math.sqrt(squares / values.length) }
}

// The share of the structure of wanted values (height × width) that values have, with its standard error from 8 × 8 blocks:
// the twin of holoview/holograms/metrics/likeness.py.
function likeness(values, wanted, { width, height }) {
    const centred = of => {
        const { mean } = moments(of)
        return of.map(value => value / mean - 1)
    }
    const x = centred(wanted), y = centred(values)
    const rows = Math.min(8, height), columns = Math.min(8, width)
    const products = new Array(rows * columns).fill(0), squares = new Array(rows * columns).fill(0)
    const firsts = (n, parts) => Array.from({ length: parts }, (_, k) => Math.floor((k * n) / parts))
    const blockOf = (n, parts) => {
        const starts = firsts(n, parts)
        return Array.from({ length: n }, (_, i) => starts.findLastIndex(start => start <= i))
    }
    const row = blockOf(height, rows), column = blockOf(width, columns)
    x.forEach((value, i) => {
        const block = row[Math.floor(i / width)] * columns + column[i % width]
        products[block] += value * y[i]
        squares[block] += value * value
    })
    const total = squares.reduce((sum, value) => sum + value, 0)
    if (!(total > 1e-12 * x.length)) return { share: 0, standard_error: Infinity }
    const share = products.reduce((sum, value) => sum + value, 0) / total
    return { share, standard_error: Math.hypot(...products.map((value, k) => value - share * squares[k])) / total }
}

// Why a contrast isn't to be stated; "" where it is.
function whyWithheld(alike, divided, raw) {
    if (alike.share + 2 * alike.standard_error < 0.5) {
        const [share, error] = [alike.share, alike.standard_error].map(value => (100 * value).toFixed(0))
        return `the picture doesn't show the target here: it has ${share} ± ${error} % of its structure`
    }
    if (divided > 1.05 * raw) {
        return `the target isn't what is shown here: division by it raises the contrast from ${raw.toFixed(3)} to ${divided.toFixed(3)}, and would lower that of a picture which shows it`
    }
    return ""
}

// Contrast σ/μ of the luminance in a region, the structure of a target divided out where one is given and shown
// (`structureFree`), with a histogram of what counts over its mean in 32 bins of 1/8, the last of which takes all that is
// brighter. mean, raw_contrast: of the luminance as it is. withheld: why contrast is null, as the target isn't shown.
function speckle(xyz, width, region, target = null, luminance = null) {
    const plain = structureFree(xyz, width, region).values, raw = moments(plain), rawContrast = raw.std / raw.mean
    let { values, divided, wanted } = target ? structureFree(xyz, width, region, target, luminance) : { values: plain, divided: false }
    let { mean, std } = moments(values), withheld = ""
    if (divided) withheld = whyWithheld(likeness(plain, Float64Array.from(wanted), region), std / mean, rawContrast)
    if (withheld) [values, divided, mean, std] = [plain, false, raw.mean, raw.std]
    const histogram = new Array(32).fill(0)
    for (const value of values) histogram[Math.min(Math.floor((value / mean) * 8), 31)] += 1
    const contrast = withheld ? null : std / mean
    return { mean: raw.mean, std: (std / mean) * raw.mean, contrast, raw_contrast: rawContrast, samples: values.length, histogram, divided, withheld }
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
