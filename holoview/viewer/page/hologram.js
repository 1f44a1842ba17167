// A hologram of the page: its recording, its state, and what of a frame is stale after a change of the state.

// The bytes of a struct from values by name, as holoview/light/gpu/shader.py packs them.
function packStruct(layout, values) {
    const view = new DataView(new ArrayBuffer(layout.size))
    for (const [name, [offset, type, count]] of Object.entries(layout.fields)) {
        const numbers = count === 1 && !Array.isArray(values[name]) ? [values[name]] : values[name]
        numbers.forEach((number, i) => {
            if (type === "float32") view.setFloat32(offset + 4 * i, number, true)
            else view.setUint32(offset + 4 * i, number, true)
        })
    }
    return new Uint8Array(view.buffer)
}

const NOT_HELD = "at this wavelength light passes the stops that the recorded kernels don't compute: move it less."

class LiveHologram {
    // bench: the numbers of the recordings' plan. heads: the recordings, one for each strategy. open: a recording's
    // replay, with its buffers filled; it is called when the first image is computed.
    constructor(document, bench, heads, open) {
        Object.assign(this, { document, bench, heads, open, structs: document.structs, stops: new Map() })
    }

    // Opens the first recording, unless it is.
    async opened() {
        if (!this.replay) this.use(await (this.opening ??= this.open(this.heads[0])))
        return this.replay
    }

    // Opens the first recording and compiles it.
    async compiled() {
        await (await this.opened()).compiled()
    }

    // Computes by a recording from now on; all results are stale.
    use(replay) {
        const { head } = replay
        this.replay = replay
        this.shape = head.shape
        this.written = new Map() // table and wavelength → what its contents were computed from
        this.done = new Map() // step → what its result was computed from
        this.xyz = null
        if (!this.bench.is_chain) this.bench.wavelengths_m.forEach((λ, w) => { // as Python wrote them
            this.written.set(`propagations 0|${w}`, `${λ}|${this.bench.nominal_gap_m}|`)
            this.written.set(`support 0|${w}`, `${λ}|${this.bench.nominal_gap_m}|`)
            if (head.plane_m === null) return
            this.written.set(`propagations 1|${w}`, `${λ}|${head.plane_m}|null`)
            this.written.set(`support 1|${w}`, `${λ}|${head.plane_m}|null`)
        })
        this.composites = head.steps.filter(step => step.name === "composite")
        this.show = head.steps.find(step => step.name === "show")
        this.ofPair = name => (frame, wavelength) => head.steps.filter(
            step => step.name === name && step.frame === frame && step.wavelength === wavelength,
        )
        this.weightsOf = step => this.boundTo(step, 0, 1)
    }

    // Compiles the recordings by other strategies of the FFTs, measures them, and goes on with the fastest.
    async chooseFastest() {
        const { device } = this.replay
        const seconds = async replay => {
            const steps = replay.head.steps.filter(step => step.wavelength === replay.head.lit[0][1])
            let best = Infinity
            for (let i = 0; i < 4; i++) {
                const began = performance.now()
                replay.run(steps)
                await device.queue.onSubmittedWorkDone()
                best = Math.min(best, performance.now() - began)
            }
            return best
        }
        for (const head of this.heads.slice(1).filter(each => suits(device, each))) {
            const other = await this.open(head)
            await other.compiled()
            if ((await seconds(other)) < (await seconds(this.replay))) this.use(other)
        }
    }

    boundTo(step, group, binding) {
        const number = step.dispatches[0][1].find(([each]) => each === group)[1]
        const entry = this.replay.head.bind_groups[number].entries.find(([each]) => each === binding)
        return this.replay.buffers[entry[1]]
    }

    stopsAt(relay, λ) {
        const key = `${relay}|${λ}`
        if (!this.stops.has(key)) this.stops.set(key, stopRows(this.bench, this.bench.relays[relay], λ))
        return this.stops.get(key)
    }

    // Why the page can't compute a laser at a wavelength, a sentence; "" where it can.
    whyNotHeld(λ) {
        if (this.bench.is_chain) return whyNotSampled(this.bench, λ)
        return this.isInBands(λ) ? "" : NOT_HELD
    }

    // Whether the kernels, which were generated for a band of frequencies, compute all that passes at a wavelength.
    isInBands(λ) {
        return this.bench.relays.every((_, relay) => {
            const rows = this.stopsAt(relay, λ)
            const [[lowY, highY], [lowX, highX]] = this.bench.bands[relay]
            return rows.low.every((low, i) => {
                const k = signed(i, rows.low.length)
                return low > rows.high[i] || (k >= lowY && k <= highY && low >= lowX && rows.high[i] <= highX)
            })
        })
    }

    // Writes an item of a table unless it was computed from the same numbers before.
    fill(table, index, key, bytes) {
        const name = `${table}|${index}`
        if (this.written.get(name) === key) return
        const data = bytes()
        this.replay.write(table, data, index * data.byteLength)
        this.written.set(name, key)
    }

    // The wavelength of a spectral line in a state: lasers are moved only where each is one line at its nominal wavelength.
    wavelength(state, w) {
        return this.bench.fixed.wavelengths ? this.bench.wavelengths_m[w] : state.wavelengths_m[w]
    }

    // The distance of a relay of a chain; the last one leads to the planes, told from where the bench tells them.
    distanceOf(state, relay) {
        const { relays, spaces, distances_m, behind, true_planes } = this.bench
        const total = names => names.reduce((sum, name) => sum + state.spaces[name], 0)
        if (relay === relays.length - 1) return trueDistance(true_planes, state.plane_m) - behind.fixed_m - total(behind.spaces)
        const own = spaces.filter(space => space.relay === relay)
        return own.length ? total(own.map(({ name }) => name)) : distances_m[relay]
    }

    // Fills the tables of a beam of a chain.
    fillBeam(state, frame, w) {
        const λ = this.wavelength(state, w)
        const { bench, structs } = this
        if (λ !== bench.wavelengths_m[w] || this.written.has(`light|${w}`)) {
            this.written.set(`light|${w}`, true)
            bench.sines.forEach((of, source) => this.fill(`wave ${w} ${source}`, 0, λ, () => packStruct(structs.PlaneWave, planeWave(bench, of[w], λ).uniform)))
        }
        bench.elements?.forEach((element, number) => {
            const shown = [element, ...element.beside].some(arm => arm.patterns?.length > 1) ? frame : 0
            const array = ref => (ref.data === null ? null : new Float32Array(this.replay.content(ref.data).slice().buffer))
            this.fill(`dense ${shown} ${number} ${w}`, 0, λ, () => transmission(bench, element, array, shown, λ))
        })
        const kernels = bench.elements?.filter(({ place }) => place === "before") ?? []
        bench.relays.forEach((each, relay) => {
            if (each.is_kernel) {
                const element = kernels.shift()
                if (element) this.fill(`pupil ${relay} ${w}`, 0, λ, () => fourierKernel(bench, element, λ))
                return
            }
            const eye = relay === bench.relays.length - 1 ? state.eye : null
            const distance = this.distanceOf(state, relay)
            let values = null
            const compute = () => (values ??= transfer(bench, this.stopsAt(relay, λ), λ, distance, eye))
            const key = `${λ}|${distance}|${JSON.stringify(eye)}`
            this.fill(`transmit ${relay} ${w} 0`, 0, key, () => packStruct(structs.Propagation, compute().uniform))
            this.fill(`support ${relay} ${w} 0`, 0, key, () => new Uint8Array(compute().support.buffer))
        })
    }

    fillWavelength(state, w) {
        const λ = this.wavelength(state, w)
        const count = this.bench.wavelengths_m.length
        const same = λ === this.bench.wavelengths_m[w] // then tables that don't move are as Python wrote them
        if (!same || this.written.has(`light|${w}`)) {
            this.written.set(`light|${w}`, true)
            this.bench.sines.forEach((of, source) => {
                const { uniform, slopes } = planeWave(this.bench, of[w], λ)
                this.fill("plane waves", source * count + w, λ, () => packStruct(this.structs.PlaneWave, uniform))
                this.fill("pixel spectra", source * count + w, λ, () => pixelSpectra(this.bench, slopes))
            })
            this.bench.strokes_m.forEach((stroke, m) => this.fill(
                `modulators ${m}`, w, λ, () => packStruct(this.structs.Modulator, { stroke_waves: stroke / λ }),
            ))
        }
        if (this.bench.nominal_gap_m !== null) this.fillRelay(0, w, λ, state.gap_m, null, "")
        this.fillRelay(1, w, λ, state.plane_m, state.eye, JSON.stringify(state.eye))
    }

    // distance: the nominal one, of the gap (0) or the plane (1).
    fillRelay(relay, w, λ, distance, eye, eyeKey) {
        const key = `${λ}|${distance}|${eyeKey}`
        let values = null
        const known = relay ? this.bench.true_planes : this.bench.true_gaps
        const compute = () => (values ??= transfer(this.bench, this.stopsAt(relay, λ), λ, trueDistance(known, distance), eye))
        this.fill(`propagations ${relay}`, w, key, () => packStruct(this.structs.Propagation, compute().uniform))
        this.fill(`support ${relay}`, w, key, () => new Uint8Array(compute().support.buffer))
    }

    // The frames and wavelengths with light in a state whose results are stale, each with the keys of field and intensity.
    stale(state) {
        return this.replay.head.lit.filter(([frame, w]) => this.power(state, frame, w)).map(([frame, w]) => {
            const field = `${this.wavelength(state, w)}|${state.gap_m}|${JSON.stringify(state.spaces)}`
            return { frame, w, field, key: `${field}|${state.plane_m}|${JSON.stringify(state.eye)}` }
        }).filter(({ frame, w, key }) => this.done.get(`${frame}|${w}`) !== key)
    }

    // Whether the light behind the last modulator is kept for a state, so that the focal plane alone is left to compute.
    hasFields(state) {
        return Boolean(this.replay?.head.is_kept) && this.stale(state).every(({ frame, w, field }) => this.done.get(`field|${frame}|${w}`) === field)
    }

    // The share of a frame's workgroups that another focal plane alone computes.
    planeShare() {
        const work = steps => steps.flatMap(({ dispatches }) => dispatches).reduce((sum, [, , [x, y, z]]) => sum + x * y * z, 0)
        const { steps } = this.replay.head
        return work(steps.filter(({ name }) => name !== "field")) / work(steps)
    }

    // Computes what the state asks for and isn't computed yet. `isOutdated` ends it early; true when it is complete.
    async update(state, isOutdated = null) {
        const replay = await this.opened()
        const { device, head } = replay
        let submitted = 0
        // runs the steps of a frame and wavelength; false where the state is outdated
        const run = async steps => {
            if (isOutdated && submitted++ % 2 === 1) await device.queue.onSubmittedWorkDone()
            await replay.compiled(steps)
            if (isOutdated?.()) return false
            replay.run(steps)
            return true
        }
        const stale = this.stale(state)
        for (const { frame, w, field } of stale) {
            if (this.bench.is_chain) this.fillBeam(state, frame, w)
            else this.fillWavelength(state, w)
            const name = `field|${frame}|${w}`
            if (!head.is_kept || this.done.get(name) === field) continue
            if (!(await run(this.ofPair("field")(frame, w)))) return false
            this.done.set(name, field)
        }
        for (const { frame, w, key } of stale) {
            const fields = head.is_kept ? [] : this.ofPair("field")(frame, w)
            const intensities = this.ofPair("intensity")(frame, w)
            if (!(await run(intensities.flatMap((each, i) => [...fields.slice(i, i + 1), each])))) return false
            this.done.set(`${frame}|${w}`, key)
        }
        await replay.compiled()
        this.composite(state)
        this.xyz = null
        return !isOutdated?.()
    }

    power(state, frame, w) {
        const laser = this.bench.laser_of[w]
        return state.lasers[laser] ? this.bench.weights[frame][w] * state.powers[laser] : 0
    }

    composite(state) {
        this.composites.forEach((step, number) => {
            const terms = this.replay.head.lit.filter(([, , buffer]) => buffer === number).map(([frame, w, , index]) => {
                const power = this.power(state, frame, w)
                const xyz = observerWeights(this.bench.observer, this.wavelength(state, w)).map(value => value * power)
                return packStruct(this.structs.BlendTerm, { xyz, intensity_index: index })
            })
            const size = this.structs.BlendTerm.size
            const bytes = new Uint8Array(size * terms.length)
            terms.forEach((term, i) => bytes.set(term, i * size))
            this.replay.device.queue.writeBuffer(this.weightsOf(step), 0, bytes)
        })
        this.replay.run(this.composites)
    }

    // 8-bit RGBA of the image, (y, x, 4), with a matrix from XYZ to linear RGB.
    async rgba(matrix, exposure) {
        const [height, width] = this.shape
        const pitch = this.replay.head.pitch
        const scaled = column => [...matrix.map(row => row[column] * 2 ** exposure), 0]
        const encoding = packStruct(this.structs.SrgbEncoding, {
            x_to_rgb: scaled(0), y_to_rgb: scaled(1), z_to_rgb: scaled(2), width, pitch,
        })
        this.replay.device.queue.writeBuffer(this.boundTo(this.show, 0, 0), 0, encoding)
        this.replay.run([this.show])
        const padded = await this.replay.read(this.replay.head.results.srgb)
        if (pitch === width) return new Uint8ClampedArray(padded.buffer)
        const rows = new Uint8ClampedArray(4 * width * height)
        for (let y = 0; y < height; y++) rows.set(padded.subarray(4 * y * pitch, 4 * (y * pitch + width)), 4 * y * width)
        return rows
    }

    // XYZ of the image, Float32Array (y, x, 4).
    async readXyz() {
        this.xyz ??= new Float32Array((await this.replay.read(this.replay.head.results.xyz)).buffer)
        return this.xyz
    }
}
