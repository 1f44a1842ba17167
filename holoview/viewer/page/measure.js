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
    const mean = total(values) / values.length
    let squares = 0
    for (let k = 0; k < values.length; k++) squares += (values[k] - mean) * (values[k] - mean)
    return { mean, std: Math.sqrt(squares / values.length) }
}

const BLUR_WIDTHS = [0, 0.5, 0.7, 1, 1.4, 2, 2.8, 4] // samples, as WIDTHS of holoview/holograms/metrics/likeness.py

const MARGIN = 16 // samples that the widest blur brings in

// A target: luminance {values (y, x), width, rows} of 8-bit sRGB codes (y, x, 4). luminance: row of the matrix sRGB to XYZ.
function targetOf(codes, width, [red, green, blue]) {
    const values = new Float64Array(codes.length / 4)
    for (let k = 0; k < values.length; k++) {
        values[k] = red * DECODED[codes[4 * k]] + green * DECODED[codes[4 * k + 1]] + blue * DECODED[codes[4 * k + 2]]
    }
    return { values, width, rows: values.length / width }
}

const clamp = (value, n) => Math.min(Math.max(value, 0), n - 1)

// The same target, its samples taken from where place(y, x) says; its border goes on beyond it.
function rearranged({ values, width, rows }, place) {
    const found = values.map((_, k) => {
        const [y, x] = place(Math.floor(k / width), k % width)
        return values[clamp(y, rows) * width + clamp(x, width)]
    })
    return { values: found, width, rows }
}

// A region of a target with a margin of samples around it; the border of the picture goes on beyond it.
function targetAround({ values, width, rows }, region, margin = MARGIN) {
    const across = region.width + 2 * margin, down = region.height + 2 * margin, found = new Float64Array(across * down)
    for (let k = 0, y = 0; y < down; y++) {
        const row = clamp(region.y + y - margin, rows) * width
        for (let x = 0; x < across; x++, k++) found[k] = values[row + clamp(region.x + x - margin, width)]
    }
    return found
}

// The region of such a luminance, behind a Gaussian of a standard deviation in samples.
function blurredTarget(around, region, blur) {
    const radius = Math.floor(4 * blur + 0.5), width = region.width + 2 * MARGIN, first = MARGIN - radius
    const kernel = Array.from({ length: 2 * radius + 1 }, (_, k) => (blur ? Math.exp(-0.5 * ((k - radius) / blur) ** 2) : 1))
    const whole = total(kernel), lines = region.height + 2 * radius, weights = Float64Array.from(kernel, value => value / whole)
    const across = new Float64Array(lines * region.width), found = new Float64Array(region.width * region.height)
    const sumAt = (from, start, step) => {
        let sum = 0
        for (let j = 0, k = start; j <= 2 * radius; j++, k += step) sum += weights[j] * from[k]
        return sum
    }
    for (let k = 0, y = 0; y < lines; y++) {
        const start = (first + y) * width + first
        for (let x = 0; x < region.width; x++, k++) across[k] = sumAt(around, start + x, 1)
    }
    for (let k = 0; k < found.length; k++) found[k] = sumAt(across, k, region.width)
    return found
}

const overMean = of => {
    const { mean } = moments(of)
    return of.map(value => value / mean - 1)
}

// What values (region) show of a target: blurred by the width at which they are best a multiple of it; null of a black one.
function shownTarget(values, target, region) {
    const y = overMean(values)
    const sumOf = (a, b) => {
        let sum = 0
        for (let k = 0; k < a.length; k++) sum += a[k] * b[k]
        return sum
    }
    const around = targetAround(target, region)
    let best = null
    for (const blur of BLUR_WIDTHS) {
        const wanted = blurredTarget(around, region, blur)
        if (blur === 0 && total(wanted) === 0) return null
        const x = overMean(wanted), squares = sumOf(x, x) * sumOf(y, y)
        const left = squares > 0 ? 1 - sumOf(x, y) ** 2 / squares : 1
        if (best && left >= best.left - 1e-12) break // of a pure wave all are alike
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

// Shares of structures that targets and their ratios have, and where another target is better: as _better_target of
// holoview/holograms/metrics/likeness.py does it, which derives it.
const FARTHEST = 32, MOST_STEPS = 8, FLOOR = 0.05

// The contrast that division by what values show leaves; infinite where that can't be told.
function contrastLeft(values, wanted) {
    const floor = (TARGET_FLOOR * total(wanted)) / wanted.length, ratio = new Float64Array(values.length) // but for its gain
    let count = 0
    for (let k = 0; k < values.length; k++) if (wanted[k] > 0 && wanted[k] >= floor) ratio[count++] = values[k] / wanted[k]
    const { mean, std } = moments(ratio.subarray(0, count))
    return mean > 0 ? std / mean : Infinity
}

// Fourier transform of complex lines, in place: count lines of a length that is a power of two, from sample to sample by step.
function transformLines(re, im, count, length, next, step, sign) {
    const a = new Float64Array(length), b = new Float64Array(length), bits = Math.log2(length)
    const order = Uint32Array.from({ length }, (_, k) => { let r = 0; for (let i = 0; i < bits; i++) r |= ((k >> i) & 1) << (bits - 1 - i); return r })
    const cos = Float64Array.from({ length }, (_, k) => Math.cos((2 * Math.PI * k) / length)), sin = Float64Array.from({ length }, (_, k) => sign * Math.sin((2 * Math.PI * k) / length))
    for (let line = 0; line < count; line++) {
        const first = line * next
        for (let k = 0; k < length; k++) [a[k], b[k]] = [re[first + order[k] * step], im[first + order[k] * step]]
        for (let half = 1; half < length; half *= 2) {
            for (let start = 0; start < length; start += 2 * half) {
                for (let k = 0; k < half; k++) {
                    const w = (k * length) / (2 * half), i = start + k, j = i + half
                    const u = a[j] * cos[w] - b[j] * sin[w], v = a[j] * sin[w] + b[j] * cos[w]
                    a[j] = a[i] - u; b[j] = b[i] - v; a[i] += u; b[i] += v
                }
            }
        }
        for (let k = 0; k < length; k++) { re[first + k * step] = a[k]; im[first + k * step] = b[k] }
    }
}

// Sums of x (wider by 2·reach each way) times y at the displacements 0 … 2·reach of x, down and across.
function correlationSums(y, x, { width, height }, reach) {
    const across = width + 2 * reach, power = n => 2 ** Math.ceil(Math.log2(n)), [rows, columns] = [power(height + 2 * reach), power(across)]
    const re = new Float64Array(rows * columns), im = new Float64Array(rows * columns), side = 2 * reach + 1
    x.forEach((value, k) => { re[Math.floor(k / across) * columns + (k % across)] = value })
    y.forEach((value, k) => { im[Math.floor(k / width) * columns + (k % width)] = value })
    transformLines(re, im, rows, columns, columns, 1, -1)
    transformLines(re, im, columns, rows, 1, columns, -1)
    const a = new Float64Array(re.length), b = new Float64Array(re.length) // X·conj(Y) of the spectrum of x + i·y
    for (let j = 0; j < rows; j++) {
        for (let i = 0; i < columns; i++) {
            const k = j * columns + i, o = ((rows - j) % rows) * columns + ((columns - i) % columns)
            const xr = (re[k] + re[o]) / 2, xi = (im[k] - im[o]) / 2, yr = (im[k] + im[o]) / 2, yi = (re[o] - re[k]) / 2
            a[k] = xr * yr + xi * yi
            b[k] = xi * yr - xr * yi
        }
    }
    transformLines(a, b, rows, columns, columns, 1, 1)
    transformLines(a, b, columns, rows, 1, columns, 1)
    return Float64Array.from({ length: side * side }, (_, k) => a[Math.floor(k / side) * columns + (k % side)] / a.length)
}

// Sums of values (wider by 2·reach each way) over a region, at the displacements of `correlationSums`.
function windowSums(values, { width, height }, reach) {
    const across = width + 2 * reach, down = height + 2 * reach, line = across + 1, side = 2 * reach + 1, sums = new Float64Array(line * (down + 1))
    for (let y = 0; y < down; y++) {
        for (let x = 0, row = 0; x < across; x++) {
            row += values[y * across + x]
            sums[(y + 1) * line + x + 1] = sums[y * line + x + 1] + row
        }
    }
    return Float64Array.from({ length: side * side }, (_, k) => {
        const y = Math.floor(k / side), x = k % side, [top, bottom] = [y * line, (y + height) * line]
        return sums[bottom + x + width] - sums[top + x + width] - sums[bottom + x] + sums[top + x]
    })
}

// Samples [down, right] by which a target fits values best when it is displaced.
function displacementOf(values, target, region) {
    const reach = Math.min(FARTHEST, Math.floor(region.width / 4), Math.floor(region.height / 4))
    if (reach === 0) return [0, 0]
    const logarithm = of => {
        const floor = (FLOOR * total(of)) / of.length, found = of.map(value => Math.log(Math.max(value, floor))), mean = total(found) / found.length
        return found.map(value => value - mean)
    }
    const y = logarithm(values), x = logarithm(targetAround(target, region, reach)), n = values.length, side = 2 * reach + 1
    const sums = windowSums(x, region, reach), squares = windowSums(x.map(value => value * value), region, reach)
    let [most, peak] = [-Infinity, [0, 0]]
    correlationSums(y, x, region, reach).forEach((sum, k) => {
        const found = sum / Math.sqrt(Math.max(squares[k] - sums[k] ** 2 / n, 1e-9 * n))
        if (found > most) [most, peak] = [found, [reach - Math.floor(k / side), reach - (k % side)]]
    })
    const displaced = rearranged(target, (y, x) => [y - peak[0], x - peak[1]]), { blur } = shownTarget(values, displaced, region) ?? { blur: 0 }
    const wider = { x: region.x - reach, y: region.y - reach, width: region.width + 2 * reach, height: region.height + 2 * reach }
    const blurred = blurredTarget(targetAround(target, wider), wider, blur), tried = new Map()
    const contrast = ([down, right]) => {
        const key = `${down} ${right}`, [y0, x0] = [reach - down, reach - right]
        if (!tried.has(key)) {
            const isInside = Math.min(y0, x0) >= 0 && Math.max(y0, x0) <= 2 * reach
            const part = new Float64Array(isInside ? values.length : 0)
            for (let k = 0; k < part.length; k += region.width) {
                const start = (y0 + k / region.width) * wider.width + x0
                part.set(blurred.subarray(start, start + region.width), k)
            }
            tried.set(key, { by: [down, right], left: isInside ? contrastLeft(values, part) : Infinity })
        }
        return tried.get(key).left
    }
    const least = places => places.reduce((best, of) => (contrast(of) < contrast(best) ? of : best))
    const steps = [0, -1, 1].flatMap(j => [0, -1, 1].map(i => [j, i]))
    for (let at of [[0, 0], peak]) {
        for (let step = 0; step < MOST_STEPS; step++) {
            const best = least(steps.map(([j, i]) => [at[0] + j, at[1] + i]))
            if (best[0] === at[0] && best[1] === at[1]) break
            at = best
        }
    }
    return [...tried.values()].reduce((best, of) => (of.left < best.left ? of : best)).by
}

// The contrasts that a rival and what is shown leave, where values fit the rival better; else null.
function contrastsIfBetter(values, wanted, rival, blocks) {
    const floorOf = of => (FLOOR * total(of)) / of.length, [low, least] = [floorOf(wanted), floorOf(rival)]
    const usable = values.map((_, k) => (wanted[k] >= low && rival[k] >= least ? 1 : 0)), count = total(usable)
    const isSure = ({ share, error }) => share - 2 * error > 0.5
    if (2 * count < values.length || !values.some((value, k) => usable[k] && value > 0) || !(total(rival) > 0)) return null
    if (!isSure(likeness(values, rival, blocks))) return null
    const ratio = (of, to) => {
        const found = of.map((value, k) => (usable[k] ? value / to[k] : 0)), mean = total(found) / count
        return found.map((value, k) => (usable[k] ? value / mean : 1))
    }
    const given = ratio(values, wanted), left = ratio(values, rival), difference = ratio(rival, wanted)
    const squares = blockSums(blocks, difference.map(value => (value - 1) ** 2)), own = total(squares.map(value => value * value))
    if (!(own > 0 && total(squares) ** 2 >= 4 * own)) return null
    if (!isSure(likeness(given, difference, blocks)) || isSure(likeness(left, ratio(wanted, rival), blocks))) return null
    const [contrast, beside] = [left, given].map(of => moments(of.filter((_, k) => usable[k])).std)
    return { contrast, given: beside }
}

// The target that fits values best, if clearly better than the given one; null where there is none. shown: of
// `shownTarget`. others: [what, target] of other planes.
function betterTarget(values, target, shown, region, blocks, others, areMistakable) {
    const { rows, width } = target, curve = power => ({ ...target, values: target.values.map(value => value ** power) })
    const by = displacementOf(values, target, region)
    const words = [[by[1], "to the right", "to the left"], [by[0], "down", "up"]].filter(([n]) => n)
    const moved = words.map(([n, ahead, back]) => `${Math.abs(n)} px ${n < 0 ? back : ahead}`).join(" and ")
    const turned = [
        ["mirrored", rearranged(target, (y, x) => [y, width - 1 - x])],
        ["upside down", rearranged(target, (y, x) => [rows - 1 - y, x])],
        ["turned by 180°", rearranged(target, (y, x) => [rows - 1 - y, width - 1 - x])],
    ]
    const common = [["read as a signal, not as light,", curve(2.2)], ["read as light, not as a signal,", curve(1 / 2.2)]]
    if (moved) turned.unshift([`displaced by ${moved}`, rearranged(target, (y, x) => [y - by[0], x - by[1]])])
    const most = 1.05 * contrastLeft(values, shown.wanted)
    let best = null
    for (const [what, rival] of [...turned, ...common, ...others]) {
        if (contrastLeft(values, blurredTarget(targetAround(rival, region), region, shown.blur)) > most) continue
        const fitted = shownTarget(values, rival, region), found = fitted && contrastsIfBetter(values, shown.wanted, fitted.wanted, blocks)
        if (found && (!best || found.contrast / found.given < best.contrast / best.given)) best = { what, ...found, isCommon: [...common, ...others].some(([name]) => name === what), isKnownWrong: !areMistakable && others.some(([name]) => name === what) }
    }
    return best
}

// What fits better, and by how much.
const textOf = ({ what, contrast, given }) => `${what} it leaves a contrast of ${contrast.toFixed(3)}, as it is ${given.toFixed(3)}`

// Why a contrast isn't to be stated beside a better target; `reason` where that doesn't decide. alike: to the given one.
function whyAnother(better, alike, reason) {
    if (!better || better.isKnownWrong) return reason
    const { contrast, given, isCommon } = better
    if (given <= (isCommon ? Math.max(1.2 * contrast, Math.hypot(contrast, 0.1)) : 1.1 * contrast)) return reason
    const first = isCommon && alike.share + 2 * alike.error < 0.5 ? reason : "the target isn't what is shown here"
    return `${first}; ${textOf(better)}`
}

// Why a contrast isn't to be stated; "" where it is. ratio, usable: of `structureFree`.
function whyWithheld(values, wanted, { ratio, usable }, region, divided, raw) {
    const blocks = blocksOf(region), alike = likeness(values, wanted, blocks), percent = ({ share, error }) => `${(100 * share).toFixed(0)} ± ${(100 * error).toFixed(0)} %`
    const structure = moments(wanted), variation = (structure.std / structure.mean) ** 2
    const isJudged = variation * (1 + 2 * Math.abs(alike.share)) >= 0.01 * divided.contrast ** 2
    if (isJudged && alike.share + 2 * alike.error < 0.5) return `the picture doesn't show the target here: it has ${percent(alike)} of its structure`
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
    if (variation < 0.1 * divided.contrast ** 2) return ""
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

// The part of a region that departs from its target further than speckle does: {box, share, contrast of the rest}, or null;
// the twin of holoview/holograms/metrics/local_misfit.py, which derives it.
function localMisfit({ ratio, usable }, { width, height }) {
    const scores = normalScores(ratio, usable), line = width + 1, count = total(usable), edges = new Float64Array(line * (height + 1))
    const integral = of => {
        const sums = new Float64Array(line * (height + 1))
        for (let y = 0; y < height; y++) {
            for (let x = 0, row = 0; x < width; x++) {
                row += of[y * width + x]
                sums[(y + 1) * line + x + 1] = sums[y * line + x + 1] + row
            }
        }
        return sums
    }
    const sums = [scores, usable].map(integral), windows = []
    for (let k = 0, wide; (wide = 4 * 2 ** (k / 2)) <= Math.floor(Math.min(width, height) / 2); k++) {
        const side = Math.round(wide), step = Math.max(Math.floor(side / 4), 1), full = []
        for (let y = 0; y + side <= height; y += step) {
            for (let x = 0; x + side <= width; x += step) {
                const [a, b] = [y * line + x, (y + side) * line + x]
                const [sum, samples] = sums.map(of => of[b + side] - of[a + side] - of[b] + of[a])
                if (2 * samples >= side ** 2) full.push({ x, y, mean: sum / Math.sqrt(Math.max(samples, 1)) })
            }
        }
        windows.push({ side, full })
    }
    let area = 0, largest = 0
    for (const { side, full } of windows) {
        if (64 * side ** 2 > width * height || !full.length) continue
        const means = full.map(of => of.mean), middle = medianOf(means)
        area = Math.max(area, (1.4826 * medianOf(means.map(mean => Math.abs(mean - middle)))) ** 2)
        largest = side ** 2
    }
    if (!(area > 0 && 4 * area <= largest)) return null
    const tried = windows.reduce((sum, of) => sum + of.full.length, 0), limit = Math.sqrt(2 * Math.log(tried / 1e-3) * area)
    for (const { side, full } of windows) {
        for (const { x, y } of full.filter(of => Math.abs(of.mean) > limit)) {
            for (const [down, right, sign] of [[0, 0, 1], [side, side, 1], [side, 0, -1], [0, side, -1]]) edges[(y + down) * line + x + right] += sign
        }
    }
    for (let y = 0; y < height; y++) {
        for (let x = 0, row = 0; x < width; x++) {
            row += edges[y * line + x]
            edges[y * line + x] = row + (y > 0 ? edges[(y - 1) * line + x] : 0)
        }
    }
    const box = { left: width, right: -1, top: height, bottom: -1 }, rest = []
    let found = 0
    for (let k = 0; k < ratio.length; k++) {
        const [y, x] = [Math.floor(k / width), k % width]
        if (!usable[k]) continue
        if (edges[y * line + x] < 0.5) { rest.push(ratio[k]); continue }
        found += 1
        box.left = Math.min(box.left, x); box.right = Math.max(box.right, x); box.top = Math.min(box.top, y); box.bottom = Math.max(box.bottom, y)
    }
    const own = moments(rest)
    if (!found || rest.length < 2 || !(own.mean > 0)) return null
    return { x: box.left, y: box.top, width: box.right - box.left + 1, height: box.bottom - box.top + 1, share: found / count, contrast: own.std / own.mean }
}

function medianOf(values) {
    const sorted = Float64Array.from(values).sort(), half = sorted.length >> 1
    return sorted.length % 2 ? sorted[half] : (sorted[half - 1] + sorted[half]) / 2
}

// The normal scores of the ranks of those values that count; equal values have their mean rank. 0 elsewhere.
function normalScores(values, usable) {
    const order = Float64Array.from(values.filter((_, k) => usable[k])).sort(), n = order.length, scores = new Map()
    for (let k = 0, end; k < n; k = end) {
        for (end = k + 1; end < n && order[end] === order[k]; end++);
        const below = (k + end) / 2 / n
        scores.set(order[k], 4.91 * (below ** 0.14 - (1 - below) ** 0.14))
    }
    return values.map((value, k) => (usable[k] ? scores.get(value) : 0))
}

// Whether a contrast is so many times above that of the rest, where a part of a region departs from its target.
function isRaised(misfit, contrast, times) {
    return Boolean(misfit) && contrast > Math.max(times * misfit.contrast, Math.hypot(misfit.contrast, 0.1))
}

function partInWords({ x, y, width, height, share, contrast }, region) {
    return `${(100 * share).toFixed(0)} % of the samples, within ${width} × ${height} from (${region.x + x}, ${region.y + y}), ` +
        `depart from the target further than speckle does; without them the contrast is ${contrast.toFixed(3)}`
}

// Contrast σ/μ of the luminance in a region, the structure of a target divided out where one is given and shown
// (`structureFree`), with a histogram of what counts over its mean in 32 bins of 1/8, the last of which takes all that is
// brighter. mean, raw_contrast: of the luminance as it is. withheld: why contrast is null, as the target isn't shown.
// doubt: why a contrast beside a target that is stated may be wrong.
// blur_px: of the target in the picture. target: of `targetOf`. others: [what, target] of other planes.
// areMistakable: whether one of these may be the given plane's; else it is only said that one fits better.
function speckle(xyz, width, region, target = null, others = [], areMistakable = true) {
    const plain = new Float64Array(region.width * region.height)
    plain.forEach((_, k) => { plain[k] = xyz[4 * ((region.y + Math.floor(k / region.width)) * width + region.x + (k % region.width)) + 1] })
    const raw = moments(plain), rawContrast = raw.std / raw.mean
    const shown = target && shownTarget(plain, target, region)
    let values = plain, { mean, std } = raw, withheld = "", doubt = "", divided = false
    if (shown) {
        const free = structureFree(plain, shown.wanted), counted = free.ratio.filter((_, k) => free.usable[k]), own = moments(counted)
        const blocks = blocksOf(region), alike = likeness(plain, shown.wanted, blocks)
        const reason = whyWithheld(plain, shown.wanted, free, region, { ...own, contrast: own.std / own.mean }, rawContrast)
        const better = betterTarget(plain, target, shown, region, blocks, others, areMistakable)
        const divisor = moments(shown.wanted), hasStructure = (divisor.std / divisor.mean) ** 2 >= 0.1 * (own.std / own.mean) ** 2
        withheld = whyAnother(better, alike, reason)
        const misfit = !withheld && hasStructure ? localMisfit(free, region) : null, dividedContrast = own.std / own.mean
        if (isRaised(misfit, dividedContrast, 1.2)) {
            withheld = `the target isn't what is shown here: ${partInWords(misfit, region)}, as it is ${dividedContrast.toFixed(3)}`
        }
        const doubts = better ? [`another target fits better: ${textOf(better)}`] : []
        if (isRaised(misfit, dividedContrast, 1.1)) doubts.push(partInWords(misfit, region))
        if (dividedContrast > 1.1) {
            doubts.push(`speckle has a contrast of 1 at most, and ${dividedContrast.toFixed(3)} is left beside the target: few bright samples decide it, or the target isn't what is shown`)
        }
        if (!withheld) doubt = doubts.join("; ")
        if (!withheld) [values, mean, std, divided] = [counted, own.mean, own.std, true]
    }
    const histogram = new Array(32).fill(0)
    for (const value of values) histogram[Math.min(Math.floor((value / mean) * 8), 31)] += 1
    const contrast = withheld ? null : std / mean, blur_px = shown ? shown.blur : 0
    return { mean: raw.mean, std: (std / mean) * raw.mean, contrast, raw_contrast: rawContrast, samples: values.length, histogram, divided, withheld, doubt, blur_px }
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
