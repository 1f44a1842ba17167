// The numbers of a frame that change with a slider: the twin of the parts of holoview/light/model/{plan,transfer,passband,eye}.py
// and holoview/light/colour.py that fill the tables of a frame recording. All of it is float64 in the same order of
// operations; what is fixed point, and which frequencies pass, is equal in all bits (tests/page/test_bench_twin.py).
//
// Symbols: λ wavelength, P padded samples, k signed frequency index, df = 1/(P·dx); lengths in metres, pairs (y, x).

const BEYOND = 0x3fffffff // a frequency index that no grid has
const HAIR = 1e-12 // of half a square stop: its edges are left out

// Signed frequency index of bin i of n, in the order of numpy.fft.
const signed = (i, n) => (i < Math.ceil(n / 2) ? i : i - n)

// First index of 0…count−1 at which `isBehind(index)` is true, for a condition that changes once.
function firstIndex(count, isBehind) {
    let low = 0
    let high = count
    while (low < high) {
        const middle = (low + high) >> 1
        if (isBehind(middle)) high = middle
        else low = middle + 1
    }
    return low
}

// A phase in turns, modulo one, in fixed point: [32 bits, 16 guard bits].
function fixedPoint(turns) {
    const scaled = (turns % 1) * 2 ** 48
    let rounded = Math.floor(scaled)
    const rest = scaled - rounded
    if (rest > 0.5 || (rest === 0.5 && rounded % 2 !== 0)) rounded += 1
    rounded = ((rounded % 2 ** 48) + 2 ** 48) % 2 ** 48
    return [Math.floor(rounded / 65536), rounded % 65536]
}

// Rows of frequencies, in FFT order: {smallest, low, high} bound |k_x|, k_x and k_x of what passes.
const rowsOf = count => ({ smallest: new Int32Array(count), low: new Int32Array(count), high: new Int32Array(count) })

function setRow(rows, i, smallest, low, high) {
    rows.smallest[i] = smallest
    rows.low[i] = low > high ? 1 : low
    rows.high[i] = low > high ? 0 : high
}

// Lowest and highest k of an axis inside a disc (radius, centre: direction sines) for a row at the sine `sineY`.
function discRow(radius, centre, sineY, stepX, columns) {
    const squared = radius * radius - (sineY - centre[0]) * (sineY - centre[0])
    const first = -Math.floor(columns / 2)
    if (squared < 0) return [BEYOND, -BEYOND]
    const half = Math.sqrt(squared)
    const low = firstIndex(columns, i => stepX * (i + first) >= centre[1] - half)
    const high = firstIndex(columns, i => stepX * (i + first) > centre[1] + half) - 1
    return [low + first, high + first]
}

// Half the side of a square stop in steps of the grid's frequencies (SquareStop.half_side_bins).
function halfSideBins(square, λ, padded, upsample, pitch) {
    if (square.half_side_na !== null) return (square.half_side_na * padded * (pitch / upsample)) / λ
    const ratio = square.wavelength_m === null ? 1.0 : square.wavelength_m / λ
    return (padded / (2 * upsample)) * (square.scale * ratio)
}

// The frequencies that a relay's stops pass at a wavelength (passband.stop_rows).
function stopRows(bench, relay, λ) {
    const { padded } = bench.grid
    const { samples: upsample, pitch_m: pitch } = relay.order
    const [stepY, stepX] = padded.map(n => λ * (1.0 / (n * (pitch / upsample))))
    const [rowCount, columns] = padded
    const rows = rowsOf(rowCount)
    const half = Math.floor(columns / 2)
    const squareX = k => (stepX * k) * (stepX * k)
    const square = relay.square && padded.map((n, axis) => {
        const middle = (relay.centre_na[axis] * n * (pitch / upsample)) / λ
        const side = halfSideBins(relay.square, λ, n, upsample, pitch) * (1 - HAIR)
        return [Math.floor(middle - side) + 1, Math.ceil(middle + side) - 1]
    })
    for (let i = 0; i < rowCount; i++) {
        const k = signed(i, rowCount)
        const sineY = stepY * k
        const edge = firstIndex(half + 1, j => squareX(j) >= 1.0 - sineY * sineY) - 1
        let low = Math.max(-edge, -half)
        let high = Math.min(edge, Math.ceil(columns / 2) - 1)
        if (relay.iris_na !== null) {
            const disc = discRow(relay.iris_na, relay.centre_na, sineY, stepX, columns)
            low = Math.max(low, disc[0])
            high = Math.min(high, disc[1])
        }
        if (square) {
            low = k >= square[0][0] && k <= square[0][1] ? Math.max(low, square[1][0]) : BEYOND
            high = Math.min(high, square[1][1])
        }
        const block = relay.dc_block_na
        const smallest = block === null ? 0 : firstIndex(half + 1, j => squareX(j) > block * block - sineY * sineY)
        setRow(rows, i, smallest, low, high)
    }
    return rows
}

// The support by columns, as the shaders read it: (P_x, 4) int32 (passband.column_support).
function columnSupport(rows, columns) {
    const count = rows.low.length
    const first = -Math.floor(count / 2)
    const at = new Int32Array(count) // index in FFT order of the row k = first + i
    for (let i = 0; i < count; i++) at[i] = (i + first + count) % count
    const low = i => (rows.low[at[i]] > rows.high[at[i]] ? BEYOND : rows.low[at[i]])
    const high = i => (rows.low[at[i]] > rows.high[at[i]] ? -BEYOND : rows.high[at[i]])
    const rise = bound => { // running maxima from either end
        const up = new Int32Array(count)
        const down = new Int32Array(count)
        for (let i = 0, best = -BEYOND; i < count; i++) up[i] = best = Math.max(best, bound(i))
        for (let i = 0, best = -BEYOND; i < count; i++) down[i] = best = Math.max(best, bound(count - 1 - i))
        return [up, down]
    }
    const [[upHigh, downHigh], [upLow, downLow]] = [rise(high), rise(i => -low(i))]
    const positive = count + first // rows k = 0, 1, …
    const table = new Int32Array(4 * columns)
    for (let j = 0; j < columns; j++) {
        const k = signed(j, columns)
        const begin = Math.max(firstIndex(count, i => upHigh[i] >= k), firstIndex(count, i => upLow[i] >= -k))
        const end = count - 1 - Math.max(firstIndex(count, i => downHigh[i] >= k), firstIndex(count, i => downLow[i] >= -k))
        const hole = firstIndex(positive, i => rows.smallest[at[i - first]] <= Math.abs(k))
        const found = begin <= end
        table.set([hole, found ? begin + first : 1, found ? end + first : 0], 4 * j)
        if (table[4 * j + 1] > table[4 * j + 2]) table.set([1, 0], 4 * j + 1)
    }
    return table
}

// How much larger z is on which the eye is focused at a wavelength (Eye.focus_shift_m).
function focusShift(eye, λ) {
    const refraction = m => 1.68524 - 633.46 / (m * 1e9 - 214.102)
    let error = eye.mean_sphere_dpt
    if (eye.chromatic) error = error + refraction(λ) - refraction(eye.reference_m)
    return -(eye.eyepiece_m * eye.eyepiece_m) * error
}

// The true distance where a nominal one is asked for, along straight lines between known ones; known: null without effects.
function trueDistance(known, nominal) {
    if (!known) return nominal
    if (known.true_m.length === 1) return known.true_m[0]
    const from = known.nominal_m
    const i = Math.min(Math.max(firstIndex(from.length, j => from[j] > nominal), 1), from.length - 1)
    const share = Math.min(Math.max((nominal - from[i - 1]) / (from[i] - from[i - 1]), 0), 1)
    return known.true_m[i - 1] + share * (known.true_m[i] - known.true_m[i - 1])
}

// The propagation of a wavelength through a relay to a distance (Plan.transfer): values of the struct Propagation, and
// the support by columns. eye: null for the gap and without an eye. stops: of `stopRows`.
function transfer(bench, stops, λ, distance, eye) {
    const { padded, pitch_m } = bench.grid
    const step = padded.map(n => 1.0 / (n * pitch_m))
    const rows = { smallest: stops.smallest, low: Int32Array.from(stops.low), high: Int32Array.from(stops.high) }
    let shift = [0.0, 0.0]
    if (eye) {
        const moved = focusShift(eye, λ)
        const centre = [eye.pupil_y_m / eye.eyepiece_m, eye.pupil_x_m / eye.eyepiece_m]
        distance += moved
        if (eye.chromatic_axis !== "eyepiece") shift = [-centre[0] * moved, -centre[1] * moved]
        const radius = eye.pupil_m / (2 * eye.eyepiece_m)
        for (let i = 0; i < padded[0]; i++) {
            const disc = discRow(radius, centre, λ * step[0] * signed(i, padded[0]), λ * step[1], padded[1])
            setRow(rows, i, rows.smallest[i], Math.max(rows.low[i], disc[0]), Math.min(rows.high[i], disc[1]))
        }
    }
    if (bench.propagation !== "periodic") {
        const limits = padded.map((n, axis) => {
            const slope = (2 * distance) / (n * pitch_m)
            return Math.floor(1.0 / (λ * Math.sqrt(slope * slope + 1.0)) / step[axis])
        })
        for (let i = 0; i < padded[0]; i++) {
            const inside = Math.abs(signed(i, padded[0])) <= limits[0]
            const low = inside ? Math.max(rows.low[i], -limits[1]) : BEYOND
            setRow(rows, i, rows.smallest[i], low, Math.min(rows.high[i], limits[1]))
        }
    }
    const uniform = {
        paraxial_y: fixedPoint(0.5 * distance * λ * step[0] * step[0]),
        paraxial_x: fixedPoint(0.5 * distance * λ * step[1] * step[1]),
        sine_step2: step.map(each => (λ * each) * (λ * each)),
        shift: step.map((each, axis) => fixedPoint(each * shift[axis])[0]),
        distance_waves: distance / λ,
    }
    return { uniform, support: columnSupport(rows, padded[1]) }
}

// XYZ (3) of unit intensity at a wavelength (colour.observer_weights). observer: {matrix, first_nm, table of rows}.
function observerWeights(observer, λ) {
    if (observer.constant) return observer.constant
    const nm = λ * 1e9
    const last = observer.first_nm + observer.table.length - 1
    const at = Math.min(Math.max(nm, observer.first_nm), last)
    const i = Math.min(Math.floor(at - observer.first_nm), observer.table.length - 2)
    const values = observer.table[i].map((a, c) => (observer.table[i + 1][c] - a) * (at - observer.first_nm - i) + a)
    if (!observer.matrix) return values
    return observer.matrix.map(row => row[0] * values[0] + row[1] * values[1] + row[2] * values[2])
}

// Values of the struct PlaneWave, and the spectrum of a pixel along y, then x (uniforms.plane_wave_uniform).
function planeWave(bench, sines, λ) {
    const { shape, pitch_m } = bench.grid
    const slopes = sines.map(sine => (sine * pitch_m) / λ)
    const offset = -(slopes[0] * ((shape[0] - 1) / 2) + slopes[1] * ((shape[1] - 1) / 2))
    const uniform = { slope_y: fixedPoint(slopes[0]), slope_x: fixedPoint(slopes[1]), phase_offset: fixedPoint(offset)[0] }
    return { uniform, slopes }
}

function pixelSpectra(bench, slopes) {
    const { padded, upsample } = bench.grid
    const out = new Float32Array(2 * (padded[0] + padded[1]))
    let at = 0
    for (const axis of [0, 1]) {
        for (let k = 0; k < padded[axis]; k++) {
            let [real, imaginary] = [0, 0]
            for (let j = 0; j < upsample; j++) {
                const phase = 2 * Math.PI * j * (slopes[axis] - k / padded[axis])
                real += Math.cos(phase)
                imaginary += Math.sin(phase)
            }
            out.set([real, imaginary], at)
            at += 2
        }
    }
    return out
}
