// The page: what a reader changes, and what is shown. The optics are in bench.js, the device in replay.js.

const PAGE = JSON.parse($("holoview-page").textContent)
const WHOLE_MM = metres => `${(metres * 1e3).toPrecision(4)} mm`
const SVG = "http://www.w3.org/2000/svg"
const QUICK = "Quick image; the exact one follows …"
const COMPUTING = "Computing the image of this plane …"
const SOON_MS = 1500 // an exact image that comes within it needs no quick one before
const PUPIL_RANGE_M = [0.5e-3, 12e-3] // of its diameter

// --- state ------------------------------------------------------------------------------------------------------------

function firstState(bench) {
    return {
        plane_m: PAGE.plane_m ?? bench.planes_m[Math.floor(bench.planes_m.length / 2)],
        gap_m: bench.nominal_gap_m,
        spaces: firstSpaces(bench),
        exposure: PAGE.exposure,
        ...firstLasers(bench),
        eye: bench.eye && { ...bench.eye },
        region: PAGE.region,
        view: "hologram 1",
        split: 0.5,
        others: Object.fromEntries(PAGE.holograms.flatMap((each, i) => (isOwn(i) ? [[i + 1, firstLasers(each.bench)]] : []))),
    }
}

// The lengths of the spaces of a chain that a page can change, by their names.
const firstSpaces = bench => Object.fromEntries((bench.spaces ?? []).map(space => [space.name, space.nominal_m]))

// How far the last element of a chain lies behind that from which planes are told, in a state.
const behindOf = (bench, state) => (bench.behind ? bench.behind.spaces.reduce((sum, name) => sum + state.spaces[name], bench.behind.fixed_m) : 0)

const firstLasers = bench => ({
    lasers: bench.nominal_wavelengths_m.map(() => true),
    powers: bench.nominal_wavelengths_m.map(() => 1),
    wavelengths_m: [...bench.nominal_wavelengths_m],
})

// Whether a hologram has lasers of its own: other wavelengths than the first one.
const isOwn = index => String(PAGE.holograms[index].bench.nominal_wavelengths_m) !== String(PAGE.holograms[0].bench.nominal_wavelengths_m)

// The lasers in a state that light a hologram.
const lasersOf = (state, index) => state.others[index + 1] ?? state

// Whether a region lies inside the image.
function isInside({ x, y, width, height }) {
    return [x, y, width, height].every(Number.isInteger) && x >= 0 && y >= 0 && width >= 1 && height >= 1 &&
        x + width <= PAGE.shape[1] && y + height <= PAGE.shape[0]
}

// Rules for lasers: whether a value can be, and what was expected.
function laserRules(bench) {
    const isNumber = (value, low, high) => Number.isFinite(value) && value >= low && value <= high
    const isList = (value, check) => Array.isArray(value) && value.length === bench.nominal_wavelengths_m.length && value.every(check)
    const isFixed = bench.fixed.wavelengths
    return {
        lasers: [value => isList(value, each => typeof each === "boolean"), "true or false for each laser"],
        powers: bench.fixed.powers ? [value => isList(value, each => each === 1), "1: by an effect, light doesn't rise in proportion to powers"]
            : [value => isList(value, each => isNumber(each, 0, 1e3)), "a factor from 0 to 1000 for each laser"],
        wavelengths_m: isFixed ? [value => String(value) === String(bench.nominal_wavelengths_m), "those of the file: effects or aberrations were computed for them"]
            : [value => isList(value, each => isNumber(each, 390e-9, 830e-9)), "metres from 390e-9 to 830e-9 for each laser"],
    }
}

// The state that another one becomes by some changes. Throws a Refusal, with what was expected, for what can't be.
function changed(state, bench, changes) {
    const next = { ...state }
    const refuse = (name, expected) => { throw new Refusal(`${name}: expected ${expected}.`) }
    const isNumber = (value, low, high) => Number.isFinite(value) && value >= low && value <= high
    const isObject = value => typeof value === "object" && value !== null
    const isOther = ([name, lasers]) => state.others[name] && isObject(lasers) &&
        Object.entries(lasers).every(([key, value]) => laserRules(PAGE.holograms[name - 1].bench)[key]?.[0](value))
    const isSpace = (name, value) => bench.spaces?.some(space => space.name === name && isNumber(value, ...space.range_m))
    const rules = {
        plane_m: [value => isNumber(value, ...PAGE.plane_range_m), `metres from ${PAGE.plane_range_m.join(" to ")}`],
        gap_m: [value => bench.nominal_gap_m !== null && isNumber(value, ...PAGE.gap_range_m), "metres of a gap that this bench can have"],
        spaces: [value => isObject(value) && Object.entries(value).every(([name, each]) => isSpace(name, each)),
            (bench.spaces ?? []).map(({ name, range_m }) => `metres from ${range_m.join(" to ")} of ${name}`).join(", ") || "none: of this bench no space can be changed here"],
        exposure: [value => isNumber(value, -20, 20), "stops from −20 to 20"],
        ...laserRules(bench),
        others: [value => isObject(value) && Object.entries(value).every(isOther),
            `lasers, powers or wavelengths_m of holograms with lasers of their own: ${Object.keys(state.others).join(", ") || "none here"}`],
        region: [value => value === null || (isObject(value) && isInside(value)), `samples inside the image: {x, y, width, height} in ${PAGE.shape[1]} × ${PAGE.shape[0]}`],
        view: [value => views().includes(value), `one of: ${views().join(", ")}`],
        split: [value => isNumber(value, 0, 1), "a number from 0 to 1"],
        eye: [value => bench.eye !== null && isObject(value), "settings of an eye, which this bench must have"],
    }
    for (const [name, value] of Object.entries(changes)) {
        if (!rules[name]) refuse(name, `one of ${Object.keys(rules).join(", ")}`)
        if (!rules[name][0](value)) refuse(name, rules[name][1])
        next[name] = ["eye", "spaces"].includes(name) ? { ...state[name], ...value } : Array.isArray(value) ? [...value] : value
        if (name !== "others") continue
        next.others = { ...state.others }
        for (const [i, lasers] of Object.entries(value)) next.others[i] = { ...state.others[i], ...structuredClone(lasers) }
    }
    if (next.plane_m < behindOf(bench, next)) refuse("plane_m", `${WHOLE_MM(behindOf(bench, next))} or more, where the last element stands`)
    if (next.eye && !isNumber(next.eye.pupil_m, ...PUPIL_RANGE_M)) refuse("eye.pupil_m", `metres from ${PUPIL_RANGE_M.join(" to ")}`)
    return next
}

const views = () => [
    ...PAGE.holograms.map((_, i) => `hologram ${i + 1}`),
    ...(PAGE.target ? ["target", "wipe target"] : []),
    ...(PAGE.holograms.length > 1 ? ["wipe holograms"] : []),
]
const VIEW_NAMES = { target: "Target", "wipe target": "Wipe to target", "wipe holograms": "Wipe between holograms" }
const viewName = view => VIEW_NAMES[view] ?? PAGE.holograms[Number(view.split(" ")[1]) - 1].name

// --- the viewer ---------------------------------------------------------------------------------------------------------

class Viewer {
    // holograms: each {full, quick}, LiveHologram; quick is null where full frames are quick.
    constructor(holograms, info) {
        this.holograms = holograms
        this.info = info
        this.bench = PAGE.holograms[0].bench
        this.shape = PAGE.shape
        this.state = linkedState(this.bench, state => this.requireHeld(state))
        this.pictures = new Map() // view → OffscreenCanvas
        this.zoom = null // null: the whole image; else {scale, x, y}: canvas pixels a sample, sample in the middle
        this.isWide = matchMedia("(color-gamut: p3)").matches
        this.space = this.isWide ? "display-p3" : "srgb"
        this.canvas = $("image")
        this.context = this.canvas.getContext("2d", { colorSpace: this.space })
        this.version = 0
        this.times = { quick: [], exact: [] } // of the last frames, ms
        this.planeMs = Infinity // of the last exact images for which another plane alone was computed, first as estimated
        this.isMoving = false // whether the state was changed again before its exact image was complete
        this.firstImage = new Promise(resolve => { this.showFirst = resolve })
    }

    // Throws a Refusal for wavelengths that a link or a program asks for, and that the recordings can't compute.
    requireHeld(state) {
        this.holograms.forEach(({ full }, index) => lasersOf(state, index).wavelengths_m.forEach((λ, i) => {
            const why = λ === full.bench.nominal_wavelengths_m[i] ? "" : full.whyNotHeld(λ)
            if (why) throw new Refusal(`wavelength ${i + 1}: ${why}`)
        }))
        return state
    }

    // Shows what the state says; resolves when it is computed exactly. Later changes make earlier ones end early.
    async refresh() {
        const version = ++this.version
        $("region").classList.add("old")
        const isOutdated = () => version !== this.version
        await (this.busy = (this.busy ?? Promise.resolve()).catch(() => {}).then(() => this.compute(isOutdated)))
    }

    async compute(isOutdated) {
        if (isOutdated()) return
        const began = performance.now()
        const shown = this.shownHolograms()
        const slow = shown.filter(index => this.isSlow(index))
        const isPlane = slow.length > 0 && slow.every(index => this.holograms[index].full.hasFields(this.stateOf(index)))
        const isSoon = isPlane && !this.isMoving && this.planeMs <= SOON_MS
        this.isMoving = true // until its exact image is complete
        if (isSoon) $("message").textContent = COMPUTING
        for (const index of isSoon ? [] : slow) await this.show(index, this.holograms[index].quick)
        if (slow.length && !isSoon) {
            await this.drawn()
            $("message").textContent = QUICK
            this.note("quick", performance.now() - began)
        }
        for (const index of shown) await this.holograms[index].full.compiled() // compiling isn't a part of what follows
        const exactBegan = performance.now()
        for (const index of shown) {
            if (!(await this.show(index, this.holograms[index].full, slow.length ? isOutdated : null))) return
        }
        const exactMs = performance.now() - exactBegan
        if (isPlane) this.planeMs = exactMs
        else if (this.planeMs === Infinity) this.planeMs = exactMs * Math.max(...shown.map(index => this.holograms[index].full.planeShare()))
        this.isMoving = false
        await this.drawn()
        if ([QUICK, COMPUTING].includes($("message").textContent)) $("message").textContent = ""
        this.note("exact", performance.now() - began)
        if (!isOutdated()) await this.report()
    }

    // Whether a hologram has a quick image, and its exact one isn't computed yet.
    isSlow(index) {
        const { quick, full } = this.holograms[index]
        return quick !== null && (!full.replay || full.stale(this.stateOf(index)).length > 0)
    }

    // Computes a hologram and keeps its picture; false if that ended early.
    async show(index, hologram, isOutdated = null) {
        if (!(await hologram.update(this.stateOf(index), isOutdated))) return false
        const rgba = await hologram.rgba(this.isWide ? PAGE.xyz_to_p3 : PAGE.xyz_to_srgb, this.state.exposure)
        this.keep(`hologram ${index + 1}`, rgba, hologram.shape, this.space)
        return true
    }

    async drawn() {
        if (this.state.view.includes("target")) await this.loadTarget()
        this.draw()
        $("stored").hidden = true
        this.showFirst()
    }

    // The state as it is for one of several holograms: lasers of its own bench where these differ from the first one's.
    stateOf(index) {
        const { bench } = PAGE.holograms[index]
        if (index === 0) return this.state
        const gap_m = bench.nominal_gap_m === this.bench.nominal_gap_m ? this.state.gap_m : bench.nominal_gap_m
        const own = firstSpaces(bench)
        const spaces = JSON.stringify(own) === JSON.stringify(firstSpaces(this.bench)) ? this.state.spaces : own
        const kept = { plane_m: this.state.plane_m, gap_m, spaces, eye: bench.eye && (this.state.eye ?? bench.eye) }
        return { ...this.state, ...lasersOf(this.state, index), ...kept }
    }

    shownHolograms() {
        if (this.state.view === "wipe holograms") return [0, 1]
        return this.state.view.startsWith("hologram") ? [Number(this.state.view.split(" ")[1]) - 1] : [0]
    }

    // The hologram whose lasers the controls show.
    lasersShown() {
        const [index] = this.shownHolograms()
        return isOwn(index) ? index : 0
    }

    keep(view, rgba, [height, width], colorSpace) {
        const picture = this.pictures.get(view) ?? new OffscreenCanvas(width, height)
        picture.getContext("2d", { colorSpace }).putImageData(new ImageData(rgba, width, height, { colorSpace }), 0, 0)
        this.pictures.set(view, picture)
    }

    // The target at the plane that is nearest to the state's.
    async loadTarget() {
        const index = nearestIndex(PAGE.target.planes_m, this.state.plane_m)
        if (this.targetIndex === index) return
        const { picture, codes } = await this.targetPicture(index)
        this.targetCodes = codes
        this.pictures.set("target", picture)
        this.targetIndex = index
    }

    // The target at one of its planes: {picture, codes}, a canvas and its sRGB codes (y, x, 4).
    async targetPicture(index) {
        const image = new Image()
        image.src = PAGE.target.pictures[index]
        await image.decode()
        const [height, width] = this.shape
        const picture = new OffscreenCanvas(width, height)
        const context = picture.getContext("2d", { colorSpace: "srgb" })
        context.drawImage(image, 0, 0)
        return { picture, codes: context.getImageData(0, 0, width, height).data }
    }

    // The luminance of the target at each of its planes, as `targetOf` has it.
    async targets() {
        this.targetLuminances ??= await Promise.all(PAGE.target.pictures.map(async (_, index) => targetOf((await this.targetPicture(index)).codes, this.shape[1], PAGE.srgb_luminance)))
        return this.targetLuminances
    }

    layout() {
        const { width, height } = this.canvas
        const [rows, columns] = this.shape
        const scale = this.zoom?.scale ?? Math.max(width / columns, height / rows) // their aspect is the frame's, but for rounding
        const [x, y] = this.zoom ? [this.zoom.x, this.zoom.y] : [columns / 2, rows / 2]
        return { scale, left: width / 2 - x * scale, top: height / 2 - y * scale }
    }

    draw() {
        const ratio = devicePixelRatio || 1
        const box = this.canvas.getBoundingClientRect()
        const [width, height] = [Math.round(box.width * ratio), Math.round(box.height * ratio)]
        if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height })
        const { scale, left, top } = this.layout()
        const [rows, columns] = this.shape
        this.context.imageSmoothingEnabled = scale < 2
        this.context.imageSmoothingQuality = "high"
        this.context.fillStyle = "#000"
        this.context.fillRect(0, 0, width, height)
        const place = view => {
            const picture = this.pictures.get(view)
            if (picture) this.context.drawImage(picture, left, top, columns * scale, rows * scale)
        }
        const [first, second] = this.layers()
        place(first)
        if (second) {
            const edge = left + this.state.split * columns * scale
            this.context.save()
            this.context.beginPath()
            this.context.rect(edge, 0, width, height)
            this.context.clip()
            place(second)
            this.context.restore()
            this.context.fillStyle = "#fff"
            this.context.fillRect(edge - 1, 0, 2, height)
        }
        if (this.state.region) {
            const region = this.state.region
            this.context.lineWidth = 2
            for (const [style, dash] of [["#000", []], ["#fff", [6, 6]]]) {
                this.context.strokeStyle = style
                this.context.setLineDash(dash)
                this.context.strokeRect(left + region.x * scale, top + region.y * scale, region.width * scale, region.height * scale)
            }
        }
    }

    layers() {
        if (this.state.view === "wipe target") return ["hologram 1", "target"]
        if (this.state.view === "wipe holograms") return ["hologram 1", "hologram 2"]
        return [this.state.view]
    }

    // Where a pointer is, in samples; null outside the image.
    sampleAt(event) {
        const box = this.canvas.getBoundingClientRect()
        const ratio = this.canvas.width / box.width
        const { scale, left, top } = this.layout()
        const x = Math.floor(((event.clientX - box.left) * ratio - left) / scale)
        const y = Math.floor(((event.clientY - box.top) * ratio - top) / scale)
        return x >= 0 && y >= 0 && x < this.shape[1] && y < this.shape[0] ? { x, y } : null
    }

    // What a region of the (first shown) hologram measures; the whole image without a region.
    async measure(region) {
        const { full } = this.holograms[this.shownHolograms()[0]]
        const [height, width] = this.shape
        const whole = { x: 0, y: 0, width, height }
        const r = region ?? whole
        if (!isInside(r)) throw new Refusal(`The region must lie inside the image of ${width} × ${height} samples.`)
        const xyz = await full.readXyz()
        if (!PAGE.target) return speckle(xyz, width, r)
        await this.loadTarget()
        if (Math.abs(PAGE.target.planes_m[this.targetIndex] - this.state.plane_m) > 1e-6) { // a target out of focus is another one
            const planes = PAGE.target.planes_m.map(z => WHOLE_MM(z)).join(", ")
            const withheld = `the page holds the target at ${planes} alone`
            return { ...speckle(xyz, width, r), contrast: null, withheld }
        }
        const targets = await this.targets(), others = targets.map((target, k) => [`at ${WHOLE_MM(PAGE.target.planes_m[k])}`, target])
        const found = speckle(xyz, width, r, targets[this.targetIndex], others.filter((_, k) => k !== this.targetIndex), PAGE.target.are_planes_given)
        return { ...found, psnr_db: psnr(xyz, this.targetCodes, width, r, PAGE.xyz_to_srgb) }
    }

    // The state as the page's address, except within a report.
    keepLink() {
        $("link-note").textContent = ""
        if (location.protocol !== "about:") history.replaceState(null, "", toHash(this.state, this.bench))
    }

    async report() {
        const found = await this.measure(this.state.region)
        const where = this.state.region ? "In the region" : "In the whole image"
        const stated = found.withheld ? `speckle contrast withheld (${found.withheld}), raw ${found.raw_contrast.toFixed(3)}` : `${found.divided ? "" : "raw "}speckle contrast ${found.contrast.toFixed(3)}`
        const parts = [`${where}: ${stated}, mean luminance ${found.mean.toPrecision(3)}`]
        if (found.doubt) parts.push(found.doubt)
        if (found.psnr_db !== undefined) parts.push(`PSNR to the target ${found.psnr_db.toFixed(2)} dB`)
        $("region").textContent = `${parts.join(", ")}.`
        $("region").classList.remove("old")
        writeSummary(summaryRows(this.state))
        drawHistogram(found)
        const here = this.state.plane_m === (PAGE.plane_m ?? this.state.plane_m)
        if (here && !this.claimed) await this.checkClaims(new Map([[JSON.stringify(this.state.region), found]]))
    }

    // What the file claims beside what this page computes, at the first state. measured: by regions in JSON, what is known.
    async checkClaims(measured) {
        this.claimed = true
        const lines = []
        for (const claim of PAGE.claims) {
            const region = JSON.stringify(claim.region)
            if (!measured.has(region)) measured.set(region, await this.measure(claim.region))
            const found = measured.get(region)
            const value = claim.quantity === "contrast" ? (found.contrast?.toFixed(3) ?? "withheld") : `${found.psnr_db?.toFixed(1)} dB`
            lines.push(`${claim.text}: ${claim.value} in the file, ${value} computed here.`)
        }
        $("claims").textContent = lines.join(" ")
    }

    // Keeps how long a frame took, and states the median of the last ones.
    note(kind, milliseconds) {
        this.times[kind] = [...this.times[kind].slice(-8), milliseconds]
        const median = times => Math.round([...times].sort((a, b) => a - b)[times.length >> 1])
        const each = [["quick", "a quick image"], ["exact", this.times.quick.length ? "the exact one" : "its image"]]
        const said = each.filter(([name]) => this.times[name].length).map(([name, text]) => `${median(this.times[name])} ms to ${text}`)
        const device = [this.info.vendor, this.info.architecture, this.info.description].filter(Boolean).join(" ")
        $("speed").textContent = `From a change ${said.join(", ")} (medians), on: ${device || "a WebGPU device"}; ${this.shape[1]} × ${this.shape[0]} samples, ${this.bench.nominal_wavelengths_m.length} wavelengths, shown as ${this.isWide ? "Display P3" : "sRGB"}.`
    }
}

// --- controls -----------------------------------------------------------------------------------------------------------

function connect(viewer) {
    const { bench } = viewer
    $("controls").hidden = false
    $("controls").addEventListener("submit", event => event.preventDefault())
    const change = async changes => {
        try {
            viewer.state = viewer.requireHeld(changed(viewer.state, bench, changes))
            update()
            await viewer.refresh()
            viewer.keepLink()
        } catch (error) {
            $("message").textContent = error instanceof Refusal ? error.message : `The device failed: ${error.message}`
        }
    }
    viewer.change = change
    const slider = (id, [low, high], changes) => {
        Object.assign($(id), { min: low, max: high })
        $(id).addEventListener("input", () => change(changes(Number($(id).value))))
    }
    slider("plane", PAGE.plane_range_m, value => ({ plane_m: value }))
    slider("exposure", [PAGE.exposure - 4, PAGE.exposure + 4], value => ({ exposure: value }))
    slider("split", [0, 1], value => ({ split: value }))
    $("gap-row").hidden = bench.nominal_gap_m === null
    if (bench.nominal_gap_m !== null) slider("gap", PAGE.gap_range_m, value => ({ gap_m: value }))
    const spaces = connectSpaces(bench, change)
    const names = views()
    const showView = connectViews(names, view => change({ view }))
    const lasers = connectLasers(viewer, change)
    const eye = connectEye(viewer, change)
    const strip = connectStrip(viewer, change)
    function update() {
        const { state } = viewer
        $("plane").value = state.plane_m
        $("plane-value").textContent = planeLabel(bench, state.plane_m)
        $("gap").value = state.gap_m
        $("gap-value").textContent = state.gap_m === null ? "" : WHOLE_MM(state.gap_m)
        spaces(state)
        $("exposure").value = state.exposure
        $("exposure-value").textContent = `${state.exposure.toFixed(1)} stops`
        $("split").value = state.split
        $("split-row").hidden = !state.view.startsWith("wipe")
        showView(state.view)
        lasers()
        eye()
        strip()
        writeSummary(summaryRows(state))
    }
    viewer.showControls = update
    update()
    connectPlay(viewer, change)
    connectZoom(viewer)
    connectPointer(viewer, change)
    connectKeys(viewer, change, names)
    $("copy-link").addEventListener("click", () => copy(location.href.split("#")[0] + toHash(viewer.state, bench)))
    $("copy-command").addEventListener("click", () => copy(commandOf(viewer.state, bench)))
    addEventListener("resize", () => viewer.draw())
    addEventListener("hashchange", () => {
        viewer.state = linkedState(bench, state => viewer.requireHeld(state))
        update()
        viewer.refresh()
    })
}

// A slider for each space of a chain that can be changed; returns what shows a state.
function connectSpaces(bench, change) {
    const rows = (bench.spaces ?? []).map(({ name, range_m: [min, max] }, i) => {
        const [row, label, input, value] = ["div", "label", "input", "output"].map(tag => document.createElement(tag))
        row.className = "row"
        Object.assign(label, { textContent: name, htmlFor: `space-${i}` })
        Object.assign(input, { type: "range", id: `space-${i}`, step: "any", min, max })
        input.addEventListener("input", () => change({ spaces: { [name]: Number(input.value) } }))
        row.append(label, input, value)
        $("space-rows").append(row)
        return { name, input, value }
    })
    return ({ spaces }) => rows.forEach(({ name, input, value }) => {
        input.value = spaces[name]
        value.textContent = WHOLE_MM(spaces[name])
    })
}

// A button for each view; returns what marks the one that is shown.
function connectViews(names, choose) {
    $("views").hidden = names.length < 2
    for (const view of names) {
        const button = document.createElement("button")
        Object.assign(button, { type: "button", textContent: viewName(view) })
        button.setAttribute("role", "radio")
        button.addEventListener("click", () => choose(view))
        $("views").append(button)
    }
    return shown => [...$("views").children].forEach((button, i) => button.setAttribute("aria-checked", String(names[i] === shown)))
}

const planeLabel = (bench, plane) => (bench.eye
    ? `${WHOLE_MM(plane)} (${((plane - bench.eye.far_plane_m) / bench.eye.eyepiece_m ** 2).toFixed(2)} D)` : WHOLE_MM(plane))

// Controls for each set of lasers: those of the first hologram, and of others with lasers of their own.
function connectLasers(viewer, change) {
    const own = PAGE.holograms.map((_, index) => index).filter(isOwn)
    const panels = [0, ...own].map(index => [index, laserPanel(viewer, change, index)])
    return () => {
        const active = viewer.lasersShown()
        for (const [index, show] of panels) show(index === active)
        $("laser-note").textContent = PAGE.holograms[active].bench.fixed.wavelengths
            ? "Wavelengths are fixed: a field, effects or aberrations were computed for them." : ""
        drawSpectrum(viewer)
    }
}

// The controls of the lasers of a hologram; returns what shows or hides them.
function laserPanel(viewer, change, index) {
    const { bench } = PAGE.holograms[index]
    const panel = document.createElement("div")
    $("laser-rows").append(panel)
    const set = (name, i, value) => {
        const changes = { [name]: lasersOf(viewer.state, index)[name].map((each, j) => (j === i ? value : each)) }
        change(index === 0 ? changes : { others: { [index + 1]: changes } })
    }
    const rows = bench.nominal_wavelengths_m.map((λ, i) => {
        const row = document.createElement("div")
        row.className = "laser"
        const [on, swatch, power, wavelength] = ["input", "span", "label", "label"].map(tag => document.createElement(tag))
        on.type = "checkbox"
        on.setAttribute("aria-label", `Laser ${i + 1}`)
        swatch.className = "swatch"
        swatch.textContent = i + 1
        const range = (label, quantity, low, high, step) => {
            const [input, text] = [document.createElement("input"), document.createElement("span")]
            Object.assign(input, { type: "range", min: low, max: high, step, ariaLabel: `${quantity} of laser ${i + 1}` })
            label.append(text, input)
            return [input, text]
        }
        const [powerInput, powerText] = range(power, "Power", 0, 2, 0.01)
        const [waveInput, waveText] = range(wavelength, "Wavelength", Math.max(λ * 1e9 - 30, 390), Math.min(λ * 1e9 + 30, 830), 0.1)
        waveInput.disabled = bench.fixed.wavelengths
        powerInput.disabled = bench.fixed.powers
        on.addEventListener("change", () => set("lasers", i, on.checked))
        powerInput.addEventListener("input", () => set("powers", i, Number(powerInput.value)))
        waveInput.addEventListener("input", () => {
            set("wavelengths_m", i, Number(waveInput.value) * 1e-9)
        })
        row.append(on, swatch, power, wavelength)
        panel.append(row)
        return { on, swatch, powerInput, powerText, waveInput, waveText }
    })
    return isShown => {
        panel.hidden = !isShown
        const { lasers, powers, wavelengths_m } = lasersOf(viewer.state, index)
        rows.forEach((row, i) => {
            row.on.checked = lasers[i]
            row.powerInput.value = powers[i]
            row.powerText.textContent = `${Math.round(powers[i] * 100)} %`
            row.waveInput.value = wavelengths_m[i] * 1e9
            row.waveText.textContent = `${(wavelengths_m[i] * 1e9).toFixed(1)} nm`
            Object.assign(row.swatch.style, { background: colourOf(wavelengths_m[i]), color: inkOn(wavelengths_m[i]) })
        })
    }
}

// The brightest colour of a laser that the screen can show, linear.
function brightest(λ) {
    const rgb = linearRgb(PAGE.xyz_to_srgb, ...observerWeights(PAGE.cones, λ))
    return rgb.map(value => Math.min(Math.max(value / Math.max(...rgb, 1e-9), 0), 1))
}

const colourOf = λ => `rgb(${brightest(λ).map(value => Math.round(255 * value ** (1 / 2.2))).join(" ")})`

// Black or white, whichever has more contrast on a laser's colour (WCAG: equal at a luminance of 0.179).
const inkOn = λ => (brightest(λ).reduce((sum, value, c) => sum + value * PAGE.srgb_luminance[c], 0) > 0.179 ? "#000" : "#fff")

function connectEye(viewer, change) {
    const { bench } = viewer
    $("eye").hidden = !bench.eye
    if (!bench.eye) return () => {}
    const reach = Math.max(3e-3, ...["pupil_x_m", "pupil_y_m"].map(name => 2 * Math.abs(bench.eye[name])))
    const inputs = { pupil: "pupil_m", "pupil-x": "pupil_x_m", "pupil-y": "pupil_y_m" }
    for (const [id, name] of Object.entries(inputs)) {
        if (id !== "pupil") Object.assign($(id), { min: -reach * 1e3, max: reach * 1e3 })
        $(id).disabled = bench.fixed.pupil
        $(id).addEventListener("input", () => change({ eye: { [name]: Number($(id).value) * 1e-3 } }))
    }
    $("chromatic").disabled = bench.fixed.pupil
    $("chromatic").addEventListener("change", () => change({ eye: { chromatic: $("chromatic").checked } }))
    return () => {
        for (const [id, name] of Object.entries(inputs)) {
            $(id).value = viewer.state.eye[name] * 1e3
            $(`${id}-value`).textContent = `${(viewer.state.eye[name] * 1e3).toFixed(2)} mm`
        }
        $("chromatic").checked = viewer.state.eye.chromatic
    }
}

function connectPlay(viewer, change) {
    let isPlaying = false
    let direction = 1
    const play = async () => {
        const [low, high] = PAGE.plane_range_m
        while (isPlaying) {
            let next = viewer.state.plane_m + (direction * (high - low)) / 60
            if (next > high || next < low) {
                direction = -direction
                next = Math.min(Math.max(next, low), high)
            }
            await change({ plane_m: next })
            await new Promise(requestAnimationFrame)
        }
    }
    viewer.togglePlay = () => {
        isPlaying = !isPlaying
        $("play").setAttribute("aria-pressed", String(isPlaying))
        $("play").textContent = isPlaying ? "Stop" : "Play"
        if (isPlaying) play()
    }
    $("play").addEventListener("click", viewer.togglePlay)
}

function connectZoom(viewer) {
    const current = () => viewer.zoom ?? { scale: viewer.layout().scale, x: viewer.shape[1] / 2, y: viewer.shape[0] / 2 }
    viewer.zoomBy = (factor, at = null) => {
        const zoom = { ...current() }
        const scale = Math.min(Math.max(zoom.scale * factor, 0.05), 64)
        if (at) for (const axis of ["x", "y"]) zoom[axis] = at[axis] + (zoom[axis] - at[axis]) * (zoom.scale / scale)
        viewer.zoom = { ...zoom, scale }
        viewer.draw()
    }
    viewer.fit = () => { viewer.zoom = null; viewer.draw() }
    viewer.panBy = (dx, dy) => {
        const zoom = current()
        viewer.zoom = { ...zoom, x: zoom.x - dx / zoom.scale, y: zoom.y - dy / zoom.scale }
        viewer.draw()
    }
    $("zoom-in").addEventListener("click", () => viewer.zoomBy(1.5))
    $("zoom-out").addEventListener("click", () => viewer.zoomBy(1 / 1.5))
    $("fit").addEventListener("click", viewer.fit)
    $("one").addEventListener("click", () => { viewer.zoom = { ...current(), scale: 1 }; viewer.draw() })
}

// Wheel: focal plane, with Ctrl zoom. Drag: a region; with Shift, the middle button or two fingers: move, pinch: zoom.
function connectPointer(viewer, change) {
    const { canvas } = viewer
    const pointers = new Map()
    let start = null
    canvas.addEventListener("wheel", event => {
        event.preventDefault()
        if (event.ctrlKey) return viewer.zoomBy(Math.exp(-event.deltaY / 200), viewer.sampleAt(event))
        const [low, high] = PAGE.plane_range_m
        const next = viewer.state.plane_m - (Math.sign(event.deltaY) * (high - low)) / 100
        return change({ plane_m: Math.min(Math.max(next, low), high) })
    }, { passive: false })
    canvas.addEventListener("pointerdown", event => {
        canvas.setPointerCapture(event.pointerId)
        pointers.set(event.pointerId, event)
        start = pointers.size === 1 && !event.shiftKey && event.button === 0 ? viewer.sampleAt(event) : null
    })
    canvas.addEventListener("pointermove", event => {
        const before = pointers.get(event.pointerId)
        if (!before) return void showSample(viewer, viewer.sampleAt(event))
        const ratio = canvas.width / canvas.getBoundingClientRect().width
        if (pointers.size === 2) {
            const [other] = [...pointers.values()].filter(each => each.pointerId !== event.pointerId)
            const apart = each => Math.hypot(each.clientX - other.clientX, each.clientY - other.clientY)
            viewer.zoomBy(apart(event) / Math.max(apart(before), 1))
            viewer.panBy(((event.clientX - before.clientX) * ratio) / 2, ((event.clientY - before.clientY) * ratio) / 2)
        } else if (start) {
            const end = viewer.sampleAt(event)
            if (end && (Math.abs(end.x - start.x) > 1 || Math.abs(end.y - start.y) > 1)) {
                viewer.state = { ...viewer.state, region: regionOf(start, end) }
                viewer.draw()
            }
        } else viewer.panBy((event.clientX - before.clientX) * ratio, (event.clientY - before.clientY) * ratio)
        pointers.set(event.pointerId, event)
    })
    const end = event => {
        pointers.delete(event.pointerId)
        const last = start && viewer.sampleAt(event)
        if (start && last && last.x === start.x && last.y === start.y) {
            viewer.state = { ...viewer.state, region: null }
            showSample(viewer, last) // a finger has no place to point at before
        }
        if (start) {
            viewer.draw()
            viewer.keepLink()
            viewer.report()
        }
        start = null
    }
    canvas.addEventListener("pointerup", end)
    canvas.addEventListener("pointercancel", end)
    canvas.addEventListener("dblclick", viewer.fit)
}

const regionOf = (a, b) => ({
    x: Math.min(a.x, b.x), y: Math.min(a.y, b.y), width: Math.abs(a.x - b.x) + 1, height: Math.abs(a.y - b.y) + 1,
})

async function showSample(viewer, at) {
    if (!at) return
    const { full } = viewer.holograms[viewer.shownHolograms()[0]]
    if (!full.replay) return // its quick image is shown still
    const xyz = await full.readXyz()
    const i = 4 * (at.y * viewer.shape[1] + at.x)
    const values = [...xyz.subarray(i, i + 3)]
    const text = numbers => numbers.map(value => value.toPrecision(4)).join(", ")
    $("sample").textContent = `x ${at.x}, y ${at.y}: XYZ ${text(values)}; linear sRGB ${text(linearRgb(PAGE.xyz_to_srgb, ...values))}.`
}

function connectKeys(viewer, change, names) {
    addEventListener("keydown", event => {
        if (event.target.matches("input, textarea, select") || event.ctrlKey || event.metaKey || event.altKey) return
        const [low, high] = PAGE.plane_range_m
        const step = sign => change({ plane_m: Math.min(Math.max(viewer.state.plane_m + (sign * (high - low)) / 100, low), high) })
        const keys = {
            ArrowLeft: () => step(-1),
            ArrowRight: () => step(1),
            " ": () => viewer.togglePlay(),
            t: () => change({ view: names[(names.indexOf(viewer.state.view) + 1) % names.length] }),
            "+": () => viewer.zoomBy(1.5),
            "-": () => viewer.zoomBy(1 / 1.5),
            0: () => viewer.fit(),
        }
        if (!keys[event.key] || (event.key === " " && event.target.matches("button"))) return
        event.preventDefault()
        keys[event.key]()
    })
}

async function copy(text) {
    try {
        await navigator.clipboard.writeText(text)
        $("message").textContent = `Copied: ${text}`
    } catch {
        $("message").textContent = text // a browser that doesn't let a file use the clipboard: to be copied by hand
    }
}

// The command that opens this hologram in the viewer with the state (holoview/viewer/page/link.py reads it).
function commandOf(state, bench) {
    const file = decodeURIComponent(location.pathname.split("/").pop())
    return `holoview view '${(file + toHash(state, bench)).replaceAll("'", "'\\''")}'`
}

// --- drawings -----------------------------------------------------------------------------------------------------------

function shape(parent, tag, attributes) {
    const element = document.createElementNS(SVG, tag)
    for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value)
    parent.append(element)
    return element
}

function drawSpectrum(viewer) {
    const svg = $("spectrum")
    svg.replaceChildren()
    const [low, high] = [390, 720]
    const x = nm => ((nm - low) / (high - low)) * 320
    const rows = PAGE.cones.table
    ;["#d33", "#393", "#36c"].forEach((colour, cone) => {
        const points = []
        for (let nm = low; nm <= high; nm += 3) points.push(`${x(nm).toFixed(1)},${(80 - 76 * rows[nm - PAGE.cones.first_nm][cone]).toFixed(1)}`)
        shape(svg, "polyline", { points: points.join(" "), fill: "none", stroke: colour, "stroke-width": 1.5 })
    })
    const { lasers, powers, wavelengths_m } = lasersOf(viewer.state, viewer.lasersShown())
    wavelengths_m.forEach((λ, i) => {
        const at = x(λ * 1e9).toFixed(1)
        const on = lasers[i] && powers[i] > 0
        shape(svg, "line", { x1: at, x2: at, y1: on ? 80 - 70 * Math.min(powers[i], 1) : 74, y2: 80, stroke: colourOf(λ), "stroke-width": on ? 3 : 1.5 })
        const number = shape(svg, "text", { x: at, y: on ? 78 - 70 * Math.min(powers[i], 1) : 72, "font-size": 9, "text-anchor": "middle", fill: "currentColor" })
        number.textContent = i + 1
    })
    for (const cone of [0, 1, 2]) { // below the numbers of lasers, and over their lines
        const most = rows.reduce((best, row, at) => (row[cone] > rows[best][cone] ? at : best), 0)
        const name = shape(svg, "text", {
            x: x(PAGE.cones.first_nm + most).toFixed(1), y: 27, "font-size": 9, "text-anchor": "middle", fill: "currentColor",
            stroke: "Canvas", "stroke-width": 3, "paint-order": "stroke",
        })
        name.textContent = "LMS"[cone]
    }
    for (const nm of [400, 500, 600, 700]) {
        const text = shape(svg, "text", { x: nm === 700 ? 318 : nm === 400 ? 2 : x(nm), y: 93, "font-size": 11, "text-anchor": nm === 400 ? "start" : nm === 700 ? "end" : "middle", fill: "currentColor" })
        text.textContent = `${nm} nm`
    }
}

function drawHistogram(found) {
    const svg = $("histogram")
    svg.removeAttribute("hidden") // an SVG element has no property of that name
    svg.replaceChildren()
    const most = Math.max(...found.histogram, 1)
    found.histogram.forEach((count, i) => shape(svg, "rect", {
        x: i * 10 + 0.5, width: 9, y: 56 - (54 * count) / most, height: (54 * count) / most, fill: "currentColor", opacity: 0.6,
    }))
    for (const mean of [0, 1, 2, 3]) {
        const text = shape(svg, "text", { x: mean * 80 + (mean ? 0 : 4), y: 70, "font-size": 11, "text-anchor": mean ? "middle" : "start", fill: "currentColor" })
        text.textContent = mean ? `${mean}× mean` : "0"
    }
}

// --- what a print holds, beside the image -------------------------------------------------------------------------------

// What the image was computed from, and what was measured in it: [name, value].
function summaryRows(state) {
    const { bench } = PAGE.holograms[0]
    const lasersAt = index => {
        const { lasers, powers, wavelengths_m } = lasersOf(state, index)
        return wavelengths_m.map((λ, i) => `${i + 1}: ${(λ * 1e9).toFixed(1)} nm ${lasers[i] ? `${Math.round(powers[i] * 100)} %` : "off"}`)
            .map(text => text.replaceAll(" ", "\u00a0")).join(", ") // a line ends between lasers
    }
    const own = Object.keys(state.others).map(number => [`Lasers of ${viewName(`hologram ${number}`)}`, lasersAt(number - 1)])
    const { eye, region } = state
    return [
        ["Shown", viewName(state.view)],
        ["Focal plane", planeLabel(bench, state.plane_m)],
        ...(state.gap_m === null ? [] : [["Gap", WHOLE_MM(state.gap_m)]]),
        ...Object.entries(state.spaces).map(([name, length_m]) => [name, WHOLE_MM(length_m)]),
        ["Lasers", lasersAt(0)], ...own,
        ...(eye ? [["Eye", `pupil ${WHOLE_MM(eye.pupil_m)}, ${WHOLE_MM(eye.pupil_x_m)} to the right, ${WHOLE_MM(eye.pupil_y_m)} downwards, ` +
            `chromatic aberration ${eye.chromatic ? "on" : "off"}`]] : []),
        ["Exposure", `${state.exposure.toFixed(1)} stops`],
        ["Region", region ? `x ${region.x}, y ${region.y}, ${region.width} × ${region.height} samples` : "the whole image"],
        ["Measured", $("region").classList.contains("old") ? "not yet, for this state" : $("region").textContent || "nothing"],
        ["Link", toHash(state, bench)],
    ]
}

function writeSummary(rows) {
    $("summary").replaceChildren(...rows.map(texts => {
        const row = document.createElement("tr")
        row.append(...texts.map((text, i) => Object.assign(document.createElement(i ? "td" : "th"), { textContent: text })))
        return row
    }))
}

// --- without WebGPU -----------------------------------------------------------------------------------------------------

const nearestIndex = (planes_m, plane_m) => planes_m
    .map((_, i) => i).reduce((a, b) => (Math.abs(planes_m[b] - plane_m) < Math.abs(planes_m[a] - plane_m) ? b : a))

// The pictures in the file of a hologram or the target: {planes_m, pictures}.
function storedOf(view) {
    if (view === "target") return PAGE.target
    const index = Number(view.split(" ")[1]) - 1
    return index > 0 ? PAGE.stored_others[index - 1] : PAGE.stored
}

// Shows the stored picture of a view nearest to a focal plane; returns that plane.
function showPicture(view, plane_m) {
    const { planes_m, pictures } = storedOf(view)
    const nearest = nearestIndex(planes_m, plane_m)
    const at = WHOLE_MM(planes_m[nearest])
    Object.assign($("stored"), { src: pictures[nearest], alt: `${viewName(view)} at ${at}, rendered before`, hidden: false })
    return planes_m[nearest]
}

// What of a state has a stored picture; of a wipe its first side.
const storedView = view => (view.startsWith("wipe") ? "hologram 1" : view)

function showStored(reason) {
    const first = firstState(PAGE.holograms[0].bench)
    const linked = linkedState(PAGE.holograms[0].bench)
    const state = { ...first, plane_m: linked.plane_m, view: storedView(linked.view) }
    if (toHash(state, PAGE.holograms[0].bench) !== toHash(linked, PAGE.holograms[0].bench)) {
        $("link-note").textContent = "Of this link, the focal plane and the hologram are shown; all else that it asks for has to be computed."
    }
    $("message").textContent = reason
    $("how").textContent = "Its pictures were rendered when the file was written;"
    $("claims").textContent = PAGE.claims.map(claim => `${claim.text}: ${claim.value} in the file; not computed again here.`).join(" ")
    $("controls").hidden = false
    for (const id of ["image", "keys", "gap-row", "space-rows", "zoom-row", "lasers", "eye", "readings", "play"]) $(id).hidden = true
    $("exposure").closest(".row").hidden = true
    $("copy-link").closest("fieldset").hidden = true
    const show = () => {
        const { planes_m } = storedOf(state.view)
        const index = nearestIndex(planes_m, state.plane_m)
        Object.assign($("plane"), { min: 0, max: planes_m.length - 1, step: 1, value: index })
        $("plane-value").textContent = WHOLE_MM(showPicture(state.view, state.plane_m))
        showView(state.view)
        writeSummary([["Shown", viewName(state.view)], ["Focal plane", WHOLE_MM(planes_m[index])], ["Picture", "rendered when the file was written"]])
    }
    const stored = views().filter(view => !view.startsWith("wipe"))
    $("compare").hidden = stored.length < 2
    const showView = connectViews(stored, view => {
        state.view = view
        show()
    })
    $("plane").addEventListener("input", () => {
        state.plane_m = storedOf(state.view).planes_m[Number($("plane").value)]
        show()
    })
    show()
}

// --- start --------------------------------------------------------------------------------------------------------------

async function start() {
    new ResizeObserver(([{ target }]) => { $("scrolls").hidden = target.scrollWidth <= target.clientWidth }).observe($("bench"))
    $("frame").style.setProperty("--aspect", `${PAGE.shape[1]} / ${PAGE.shape[0]}`)
    const linked = linkedState(PAGE.holograms[0].bench)
    showPicture(storedView(linked.view), linked.plane_m) // until the first image is computed
    const { device, info, heads, first, replay } = await opening
    device.lost.then(lost => {
        if (lost.reason !== "destroyed") $("message").textContent = `The graphics device was lost: ${lost.message}. Reload the page.`
    })
    const holograms = await Promise.all(PAGE.holograms.map(async (document_, i) => {
        const all = i === 0 ? heads : await readHeads(i)
        const data = () => inflate($(`holoview-data-${i}`).textContent)
        const open = async head => {
            const [opened, bytes] = await Promise.all([head === first ? replay : FrameReplay.open(device, head), data()])
            opened.fill(document_.contents, bytes)
            return opened
        }
        const live = (bench, isQuick) => new LiveHologram(document_, bench, all.filter(head => head.is_quick === isQuick), open)
        const hasQuick = isSoftware(info) && document_.quick
        return { full: live(document_.bench, false), quick: hasQuick ? live({ ...document_.bench, ...document_.quick }, true) : null }
    }))
    const viewer = new Viewer(holograms, info)
    connect(viewer)
    $("how").textContent = "Computed in this browser by the recorded WGSL shaders;"
    $("message").textContent = "Computing … The picture was rendered before."
    const complete = viewer.refresh()
    await Promise.race([viewer.firstImage, complete])
    if ($("message").textContent.startsWith("Computing")) $("message").textContent = ""
    complete.then(() => isSoftware(info) || holograms[0].full.chooseFastest()).catch(error => {
        $("message").textContent = `The device failed: ${error.message}`
    })
    return viewer
}

const opened = start()
window.holoview = {
    // Resolves when the first image is shown; rejected with a sentence where it can't be.
    ready: opened.then(() => undefined),
    get state() {
        return this.viewer ? structuredClone(this.viewer.state) : null
    },
    // Changes the state, as {plane_m, gap_m, spaces, lasers, powers, wavelengths_m, exposure, eye, region, view, split}; resolves when shown.
    async set(changes) {
        const viewer = await opened
        viewer.state = viewer.requireHeld(changed(viewer.state, viewer.bench, changes))
        viewer.showControls()
        await viewer.refresh()
    },
    // The image at full samples: {width, height, srgb8: Uint8Array (y, x, 3)}, of the hologram that is shown.
    async pixels() {
        const viewer = await opened
        await viewer.busy
        const { full } = viewer.holograms[viewer.shownHolograms()[0]]
        const [height, width] = viewer.shape
        const rgba = await full.rgba(PAGE.xyz_to_srgb, viewer.state.exposure)
        const srgb8 = new Uint8Array(3 * width * height)
        for (let i = 0; i < width * height; i++) srgb8.set(rgba.subarray(4 * i, 4 * i + 3), 3 * i)
        return { width, height, srgb8 }
    },
    // {contrast, raw_contrast, mean, std, samples, histogram, divided, withheld, doubt, psnr_db} of a region {x, y, width, height}, or of the whole image.
    async measure(region) {
        const viewer = await opened
        await viewer.busy
        return viewer.measure(region)
    },
}
opened.then(viewer => { window.holoview.viewer = viewer }, error => {
    showStored(error instanceof Refusal ? error.message : `The hologram can't be computed here: ${error.message}. Stored pictures are shown.`)
})
window.holoview.ready.catch(() => {})
