// What a region of an image measures: the twins of holoview/holograms/metrics/speckle.py, likeness.py and fidelity.py. Regions are samples
// {x, y, width, height}; images are XYZ, Float32Array (y, x, 4).

// Linear sRGB (3) of XYZ, not clipped.
const linearRgb = (matrix, x, y, z) => matrix.map(row => row[0] * x + row[1] * y + row[2] * z)

const srgbDecode = code => (code <= 0.04045 ? code / 12.92 : ((code + 0.055) / 1.055) ** 2.4)
const DECODED = Float64Array.from({ length: 256 }, (_, code) => srgbDecode(code / 255))

const TARGET_FLOOR = 0.05 // of a target's mean in the region, below which its samples don't count

function total(of) {
    let sum = 0
    for (let k = 0; k < of.length; k++) sum += of[k]
    return sum
}

// Values Y of a region over what they show of a target, Y/(g·T) where T is at least TARGET_FLOOR of its mean, g = ΣY/ΣT
// there; 0 elsewhere. usable: 1 where they count.
function structureFree(values, wanted) {
    const floor = (TARGET_FLOOR * total(wanted)) / wanted.length
    const usable = wanted.map(value => (value > 0 && value >= floor ? 1 : 0))
    const gain = total(values.map((value, k) => value * usable[k])) / total(wanted.map((value, k) => value * usable[k]))
    return { ratio: values.map((value, k) => (usable[k] ? value / (gain * wanted[k]) : 0)), usable }
}

// Mean and standard deviation of numbers.
function moments(values) {
    const mean = values.reduce((sum, value) => sum + value, 0) / values.length
    const squares = values.reduce((sum, value) => sum + (value - mean) * (value - mean), 0)
    return { mean, std: Math.sqrt(squares / values.length) }
}

const BLUR_WIDTHS = [0, 0.5, 0.7, 1, 1.4, 2, 2.8, 4] // samples, as WIDTHS of holoview/holograms/metrics/likeness.py

const MARGIN = 16 // samples that the widest blur brings in

// Luminance of a region of a target of 8-bit sRGB codes (y, x, 4) with MARGIN samples around it; the border of the picture
// goes on beyond it. luminance: row of the matrix sRGB to XYZ.
function targetAround(target, width, region, [red, green, blue]) {
    const rows = target.length / 4 / width, clamp = (value, n) => Math.min(Math.max(value, 0), n - 1)
    const across = region.width + 2 * MARGIN, down = region.height + 2 * MARGIN, found = new Float64Array(across * down)
    for (let k = 0, y = 0; y < down; y++) {
        for (let x = 0; x < across; x++, k++) {
            const i = 4 * (clamp(region.y + y - MARGIN, rows) * width + clamp(region.x + x - MARGIN, width))
            found[k] = red * DECODED[target[i]] + green * DECODED[target[i + 1]] + blue * DECODED[target[i + 2]]
        }
    }
    return found
}

// The region of such a luminance, behind a Gaussian of a standard deviation in samples.
function blurredTarget(around, region, blur) {
    const radius = Math.floor(4 * blur + 0.5), width = region.width + 2 * MARGIN, first = MARGIN - radius
    const kernel = Array.from({ length: 2 * radius + 1 }, (_, k) => (blur ? Math.exp(-0.5 * ((k - radius) / blur) ** 2) : 1))
    const whole = total(kernel), lines = region.height + 2 * radius
    const across = new Float64Array(lines * region.width), found = new Float64Array(region.width * region.height)
    for (let j = 0; j <= 2 * radius; j++) {
        const weight = kernel[j] / whole
        for (let k = 0, y = 0; y < lines; y++) {
            const start = (first + y) * width + first + j
            for (let x = 0; x < region.width; x++, k++) across[k] += weight * around[start + x]
        }
    }
    for (let j = 0; j <= 2 * radius; j++) {
        const weight = kernel[j] / whole, start = j * region.width
        for (let k = 0; k < found.length; k++) found[k] += weight * across[start + k]
    }
    return found
}

const overMean = of => {
    const { mean } = moments(of)
    return of.map(value => value / mean - 1)
}

// What values (region) show of a target: blurred by the width at which they are best a multiple of it; null of a black one.
function shownTarget(values, target, width, region, luminance) {
    const y = overMean(values)
    const sumOf = (a, b) => {
        let sum = 0
        for (let k = 0; k < a.length; k++) sum += a[k] * b[k]
        return sum
    }
    const around = targetAround(target, width, region, luminance)
    let best = null
    for (const blur of BLUR_WIDTHS) {
        const wanted = blurredTarget(around, region, blur)
        if (blur === 0 && total(wanted) === 0) return null
        const x = overMean(wanted), squares = sumOf(x, x) * sumOf(y, y)
        const left = squares > 0 ? 1 - sumOf(x, y) ** 2 / squares : 1
        if (best && left >= best.left) break
        best = { left, blur, wanted }
    }
    return best
}

// For each sample of a region the number of its block, of 8 × 8 or as many as there are samples each way.
function blocksOf({ width, height }) {
    const rows = Math.min(8, height), columns = Math.min(8, width), found = new Uint8Array(width * height)
    const blockOf = (n, parts) => {
        const starts = Array.from({ length: parts }, (_, k) => Math.floor((k * n) / parts))
        return Array.from({ length: n }, (_, i) => starts.findLastIndex(start => start <= i))
    }
    const row = blockOf(height, rows), column = blockOf(width, columns)
    for (let k = 0, y = 0; y < height; y++) for (let x = 0; x < width; x++, k++) found[k] = row[y] * columns + column[x]
    return found
}

// Sums over blocks of values, or of products of two.
function blockSums(blocks, first, second = null) {
    const sums = new Float64Array(blocks[blocks.length - 1] + 1)
    for (let k = 0; k < first.length; k++) sums[blocks[k]] += second ? first[k] * second[k] : first[k]
    return sums
}

// The share of the structure of wanted values that values have, with its standard error from blocks. With all below that
// judges a contrast, the twin of holoview/holograms/metrics/likeness.py, which derives it.
function likeness(values, wanted, blocks) {
    const x = overMean(wanted), products = blockSums(blocks, x, overMean(values)), squares = blockSums(blocks, x, x)
    const whole = total(squares)
    if (!(whole > 1e-12 * x.length)) return { share: 0, error: Infinity }
    const share = total(products) / whole
    return { share, error: Math.hypot(...products.map((value, k) => value - share * squares[k])) / whole }
}

// The share of the variance of what is left that features explain together: of each, the sums over blocks of its product with
// what is left, and the sum of its squares. variance: sum of squares of what is left.
function explained(features, variance) {
    let share = 0, squared = 0
    for (const { sums, squares } of features.filter(({ squares }) => squares > 0)) {
        const own = sums.reduce((sum, value) => sum + value * value, 0)
        share += (total(sums) ** 2 - own) / (squares * variance)
        squared += 2 * (own / (squares * variance)) ** 2
    }
    return { share, error: Math.sqrt(squared) }
}

// Each eighth of the usable samples by their level, as features.
function levelFeatures(rest, wanted, usable, blocks) {
    const levels = Array.from({ length: 8 }, () => ({ sums: new Float64Array(blocks[blocks.length - 1] + 1), squares: 0 }))
    const order = Uint32Array.from(usable.keys()).filter(k => usable[k]).sort((a, b) => wanted[a] - wanted[b])
    order.forEach((k, rank) => {
        const level = levels[Math.floor((rank * 8) / order.length)]
        level.sums[blocks[k]] += rest[k]
        level.squares += 1
    })
    return levels
}

// Both derivatives of the logarithm of what is shown, by central differences, one-sided at the border, as features.
function edgeFeatures(rest, wanted, usable, { width, height }, blocks) {
    const mean = total(wanted) / wanted.length, log = wanted.map(value => Math.log(Math.max(value, 1e-6 * mean)))
    const slope = (k, i, n, step) => {
        const first = i > 0 ? k - step : k, last = i < n - 1 ? k + step : k
        return last > first ? (usable[k] * (log[last] - log[first]) * step) / (last - first) : 0
    }
    const down = wanted.map((_, k) => slope(k, Math.floor(k / width), height, width)), across = wanted.map((_, k) => slope(k, k % width, width, 1))
    return [down, across].map(of => ({ sums: blockSums(blocks, rest, of), squares: total(blockSums(blocks, of, of)) }))
}

const median = of => {
    const sorted = [...of].sort((a, b) => a - b), half = sorted.length / 2
    return (sorted[Math.ceil(half) - 1] + sorted[Math.floor(half)]) / 2
}

// The share of the variance of what is left that is in blocks whose mean no speckle makes.
function inPlaces(rest, usable, blocks) {
    const counts = blockSums(blocks, usable)
    const means = [...blockSums(blocks, rest)].map((sum, k) => sum / Math.sqrt(counts[k])).filter((_, k) => counts[k] > 0)
    const middle = median(means), spread = 1.4826 * median(means.map(value => Math.abs(value - middle)))
    const beyond = means.filter(value => Math.abs(value - middle) > 5 * spread)
    const whole = Math.max(total(blockSums(blocks, rest, rest)), Number.MIN_VALUE)
    return { share: total(beyond.map(value => value * value - spread * spread)) / whole, error: (2 * spread * Math.hypot(...beyond)) / whole }
}

// Why a contrast isn't to be stated; "" where it is. ratio, usable: of `structureFree`.
function whyWithheld(values, wanted, { ratio, usable }, region, divided, raw) {
    const blocks = blocksOf(region), alike = likeness(values, wanted, blocks), percent = ({ share, error }) => `${(100 * share).toFixed(0)} ± ${(100 * error).toFixed(0)} %`
    if (alike.share + 2 * alike.error < 0.5) return `the picture doesn't show the target here: it has ${percent(alike)} of its structure`
    const other = "the target isn't what is shown here:"
    if (divided.contrast > 1.05 * raw) {
        return `${other} division by it raises the contrast from ${raw.toFixed(3)} to ${divided.contrast.toFixed(3)}, and would lower that of a picture which shows it`
    }
    const rest = ratio.map((value, k) => usable[k] * (value / divided.mean - 1)), counts = blockSums(blocks, usable)
    const squares = blockSums(blocks, rest, rest), variance = total(squares)
    const scatter = Math.hypot(...squares.map((square, k) => square - divided.contrast ** 2 * counts[k]))
    if (divided.contrast > 1.1 && divided.contrast - scatter / (divided.contrast * total(usable)) > 1) {
        return `${other} division by it leaves ${divided.contrast.toFixed(3)}, and speckle has 1 at most`
    }
    const structure = moments(wanted)
    if ((structure.std / structure.mean) ** 2 < 0.1 * divided.contrast ** 2) return ""
    const limits = [
        [explained(levelFeatures(rest, wanted, usable, blocks), variance), 0.2, "follows its levels"],
        [explained(edgeFeatures(rest, wanted, usable, region, blocks), variance), 0.15, "follows its edges, as if it were displaced"],
        [inPlaces(rest, usable, blocks), 0.2, "is in places alone"],
    ]
    for (const [found, most, what] of limits) {
        const isDoubtful = found.share - 2 * found.error > most && divided.contrast * Math.sqrt(found.share) > 0.1
        if (isDoubtful) return `${other} ${percent(found)} of the variance that division leaves ${what}`
    }
    return ""
}

// Contrast σ/μ of the luminance in a region, the structure of a target divided out where one is given and shown
// (`structureFree`), with a histogram of what counts over its mean in 32 bins of 1/8, the last of which takes all that is
// brighter. mean, raw_contrast: of the luminance as it is. withheld: why contrast is null, as the target isn't shown.
// blur_px: of the target in the picture.
function speckle(xyz, width, region, target = null, luminance = null) {
    const plain = new Float64Array(region.width * region.height)
    plain.forEach((_, k) => { plain[k] = xyz[4 * ((region.y + Math.floor(k / region.width)) * width + region.x + (k % region.width)) + 1] })
    const raw = moments(plain), rawContrast = raw.std / raw.mean
    const shown = target && shownTarget(plain, target, width, region, luminance)
    let values = plain, { mean, std } = raw, withheld = "", divided = false
    if (shown) {
        const free = structureFree(plain, shown.wanted), counted = free.ratio.filter((_, k) => free.usable[k]), own = moments(counted)
        withheld = whyWithheld(plain, shown.wanted, free, region, { ...own, contrast: own.std / own.mean }, rawContrast)
        if (!withheld) [values, mean, std, divided] = [counted, own.mean, own.std, true]
    }
    const histogram = new Array(32).fill(0)
    for (const value of values) histogram[Math.min(Math.floor((value / mean) * 8), 31)] += 1
    const contrast = withheld ? null : std / mean, blur_px = shown ? shown.blur : 0
    return { mean: raw.mean, std: (std / mean) * raw.mean, contrast, raw_contrast: rawContrast, samples: values.length, histogram, divided, withheld, blur_px }
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
