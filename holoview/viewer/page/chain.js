// What the elements of a chain multiply light by, sample by sample, and the kernels of Fourier planes: the twin of
// holoview/light/optics/chain.py. All of it is float64, rounded once to the float32 of the shaders' tables.
//
// Symbols: λ wavelength, f focal length, dx pitch of the samples, N field samples, P padded samples; pairs (y, x).

const FRAUNHOFER_M = [486.13e-9, 587.56e-9, 656.27e-9] // F, d, C, which define the Abbe number

// The focal length of a lens at a wavelength (Lens.focal_length_at).
function focalLength({ focal_length_m, abbe }, λ) {
    if (abbe === null) return focal_length_m
    const [blue, yellow, red] = FRAUNHOFER_M.map(line => line ** -2)
    return focal_length_m / (1 + (λ ** -2 - yellow) / (abbe * (blue - red)))
}

// [cosine, sine] of a number of turns.
function phasor(turns) {
    const phase = 2 * Math.PI * (turns - Math.floor(turns))
    return [Math.cos(phase), Math.sin(phase)]
}

// exp(−iπ·rate·j²) of the samples j of an axis, counted from its middle.
const chirp = (count, rate) => Array.from({ length: count }, (_, i) => phasor(-0.5 * rate * (i - (count - 1) / 2) ** 2))

// The products (y, x) of two lines of complex numbers and a factor, Float32Array (y, x, 2).
function outer([lineY, lineX], [real, imaginary]) {
    const out = new Float32Array(2 * lineY.length * lineX.length)
    let at = 0
    for (const [a, b] of lineY) {
        const [c, d] = [a * real - b * imaginary, a * imaginary + b * real]
        for (const [e, f] of lineX) {
            out[at++] = c * e - d * f
            out[at++] = c * f + d * e
        }
    }
    return out
}

// What each pixel of an element multiplies light by: a function of the pixel's index to [real, imaginary]. array: the
// numbers of a pattern or a mask; null for zeros. frame: its number among the patterns that differ.
function pixelsOf(element, array, frame, λ) {
    const { kind, stroke_m, range } = element
    const waves = 1 / λ
    if (kind === "mask") {
        const [path, amplitude] = [element.path, element.amplitude].map(each => each && array(each))
        return i => {
            const [real, imaginary] = element.path ? phasor((path?.[i] ?? 0) * waves) : [1, 0]
            const size = element.amplitude ? amplitude?.[i] ?? 0 : 1
            return [size * real, size * imaginary]
        }
    }
    const drive = array(element.patterns[frame])
    if (kind === "phase") return i => phasor((drive?.[i] ?? 0) * stroke_m * waves)
    if (kind === "amplitude") return i => [range[0] + (range[1] - range[0]) * (drive?.[i] ?? 0), 0]
    return i => { // complex: real and imaginary parts in turn
        const [real, imaginary] = drive ? [drive[2 * i], drive[2 * i + 1]] : [0, 0]
        if (stroke_m === null) return [real, imaginary]
        const turns = Math.atan2(imaginary, real) / (2 * Math.PI)
        const [cosine, sine] = phasor((turns - Math.floor(turns)) * stroke_m * waves)
        const size = Math.hypot(real, imaginary)
        return [size * cosine, size * sine]
    }
}

// The transmission of a step at the samples of the field, Float32Array (y, x, 2): of elements beside each other the mean.
function transmission(bench, element, array, frame, λ) {
    const [out, ...others] = [element, ...element.beside].map(each => ofElement(bench, each, array, frame, λ))
    if (others.length) out.forEach((value, i) => { out[i] = others.reduce((sum, other) => sum + other[i], value) / (1 + others.length) })
    return out
}

// The transmission of an element; no light passes beside its pixels.
function ofElement(bench, element, array, frame, λ) {
    const { shape: [height, width], pitch_m } = bench.grid
    if (element.kind === "lens" || element.kind === "fourier") {
        const rate = pitch_m ** 2 / (λ * focalLength(element, λ))
        return outer([chirp(height, rate), chirp(width, rate)], element.place === "behind" ? [0, -rate] : [1, 0])
    }
    const { shape: [rows, columns], size, start: [top, left] } = element
    const pixel = pixelsOf(element, array, frame, λ)
    const out = new Float32Array(2 * height * width)
    for (let row = 0; row < rows; row++) {
        const first = 2 * ((top + row * size) * width + left)
        for (let column = 0; column < columns; column++) {
            const value = pixel(row * columns + column)
            for (let i = 0; i < size; i++) out.set(value, first + 2 * (column * size + i))
        }
        for (let i = 1; i < size; i++) out.copyWithin(first + 2 * i * width, first, first + 2 * columns * size)
    }
    return out
}

// The spectrum of the chirp exp(iπ·rate·d²) for lags |d| < N along an axis of P samples, in the order of numpy.fft.
function kernelLine(count, padded, rate) {
    const [lags, turned] = [[], Array.from({ length: padded }, (_, k) => phasor(-k / padded))]
    for (let d = 0; d < count; d++) lags.push(phasor(0.5 * rate * d * d))
    return Array.from({ length: padded }, (_, k) => {
        let [real, imaginary] = lags[0]
        for (let d = 1; d < count; d++) { // lags d and −d are alike: twice the cosine
            const [a, b] = lags[d]
            const twice = 2 * turned[(k * d) % padded][0]
            real += a * twice
            imaginary += b * twice
        }
        return [real, imaginary]
    })
}

// The kernel of a Fourier element, Float32Array (P_y, P_x, 2).
function fourierKernel(bench, element, λ) {
    const { shape, padded, pitch_m } = bench.grid
    const rate = pitch_m ** 2 / (λ * element.focal_length_m)
    return outer(padded.map((count, axis) => kernelLine(shape[axis], count, rate)), [1, 0])
}

// Why samples can't hold a lens or Fourier element at a wavelength, a sentence; "" where they can (chain.py, _Walk).
function whyNotSampled(bench, λ) {
    const { shape, pitch_m } = bench.grid
    for (const element of bench.elements ?? []) {
        if (element.kind !== "lens" && element.kind !== "fourier") continue
        const f_m = Math.abs(focalLength(element, λ))
        const f = `a focal length of ${+(f_m * 1e3).toPrecision(4)} mm`
        if (f_m < ((Math.max(...shape) * pitch_m ** 2) / λ) * (1 - 1e-6)) return `at this wavelength the samples can't hold ${f}: move it less.`
        if (element.kind === "fourier" && f_m > ((Math.min(...shape) * pitch_m * element.order_m) / λ) * (1 + 1e-6)) {
            return `at this wavelength the Fourier plane behind ${f} can't hold the first order: move it less.`
        }
    }
    return ""
}
