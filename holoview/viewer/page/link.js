// The link: the state of a page as text (holoview/viewer/page/link.py reads the same).

const LINK_UNITS = { m: 1, mm: 1e-3, um: 1e-6, "µm": 1e-6, "μm": 1e-6, nm: 1e-9 }
const LINK_EXAMPLE = "#plane=9.7mm&laser3=off"
const LENGTH_EXAMPLE = "a length with its unit, such as 9.7mm"

function toHash(state, bench) {
    const parts = [`plane=${+(state.plane_m * 1e3).toPrecision(8)}mm`]
    if (state.gap_m !== bench.nominal_gap_m) parts.push(`gap=${+(state.gap_m * 1e3).toPrecision(8)}mm`)
    for (const { name, nominal_m } of bench.spaces ?? []) {
        if (state.spaces[name] !== nominal_m) parts.push(`space.${encodeURIComponent(name)}=${+(state.spaces[name] * 1e3).toPrecision(8)}mm`)
    }
    if (state.exposure !== PAGE.exposure) parts.push(`exposure=${state.exposure}`)
    const add = (prefix, { lasers, powers, wavelengths_m }, bench) => {
        lasers.forEach((on, i) => on || parts.push(`laser${prefix}${i + 1}=off`))
        powers.forEach((power, i) => power !== 1 && parts.push(`power${prefix}${i + 1}=${power}`))
        wavelengths_m.forEach((λ, i) => λ !== bench.nominal_wavelengths_m[i] && parts.push(`wavelength${prefix}${i + 1}=${+(λ * 1e9).toPrecision(8)}nm`))
    }
    add("", state, bench)
    for (const [i, lasers] of Object.entries(state.others)) add(`${i}.`, lasers, PAGE.holograms[i - 1].bench)
    if (state.eye) {
        if (state.eye.pupil_m !== bench.eye.pupil_m) parts.push(`pupil=${+(state.eye.pupil_m * 1e3).toPrecision(6)}mm`)
        for (const axis of ["x", "y"]) {
            const name = `pupil_${axis}_m`
            if (state.eye[name] !== bench.eye[name]) parts.push(`pupil_${axis}=${+(state.eye[name] * 1e3).toPrecision(6)}mm`)
        }
        if (state.eye.chromatic !== bench.eye.chromatic) parts.push(`chromatic=${state.eye.chromatic ? "on" : "off"}`)
    }
    const region = regionText(state.region)
    if (region !== regionText(PAGE.region)) parts.push(`region=${region}`)
    if (state.view !== "hologram 1") parts.push(`view=${state.view.replace(" ", "-")}`)
    if (state.view.startsWith("wipe") && state.split !== 0.5) parts.push(`split=${state.split}`)
    return `#${parts.join("&")}`
}

const regionText = region => (region ? [region.x, region.y, region.width, region.height].join() : "none")

// The state that a link asks for. Throws a Refusal, with the part that can't be followed and what was expected.
function fromHash(hash, state, bench) {
    const changes = {}
    let text
    try {
        text = decodeURIComponent(hash.slice(1))
    } catch {
        text = hash.slice(1) // a lone %
    }
    for (const part of text.split("&").filter(Boolean)) addPart(changes, part, state)
    return changed(state, bench, changes)
}

// A length in metres from text with a unit, such as 9.7mm; null of other text.
function lengthOf(text) {
    const [, value, unit] = text.trim().match(/^(-?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?) ?([nµμum]?m)$/) ?? []
    return unit ? Number(value) * LINK_UNITS[unit] : null
}

// Adds to changes of a state what a part of a link asks for.
function addPart(changes, part, state) {
    const refuse = expected => {
        throw new Refusal(`“${part.slice(0, 60)}” isn't understood; expected ${expected}.`)
    }
    const space = part.match(/^space\.([^=]+)=(.*)$/)
    if (space) {
        (changes.spaces ??= {})[space[1]] = lengthOf(space[2]) ?? refuse(LENGTH_EXAMPLE)
        return
    }
    const [, name, number, text] = part.match(/^([a-z_]+?)([\d.]*)=(.*)$/) ?? refuse(`for example ${LINK_EXAMPLE}`)
    const plain = () => (/^-?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$/.test(text) ? Number(text) : refuse("a number"))
    const metres = () => lengthOf(text) ?? refuse(LENGTH_EXAMPLE)
    const isOn = () => (text === "on" || (text === "off" ? false : refuse("on or off")))
    const set = (list, value) => { // "3" is the third laser, "2.3" that of the second hologram
        const [laser, hologram] = number.split(".").reverse()
        const from = hologram ? state.others[hologram] : state
        if (!from || !(laser >= 1 && laser <= from[list].length)) refuse("a laser that the hologram has")
        const to = hologram ? ((changes.others ??= {})[hologram] ??= {}) : changes
        to[list] ??= [...from[list]]
        to[list][laser - 1] = value
    }
    const region = () => {
        const numbers = text === "none" ? [] : text.split(",").map(each => (/^\d+$/.test(each) ? Number(each) : NaN))
        if (text !== "none" && (numbers.length !== 4 || numbers.some(Number.isNaN))) refuse("region=x,y,width,height in samples, or none")
        return text === "none" ? null : Object.fromEntries(["x", "y", "width", "height"].map((key, i) => [key, numbers[i]]))
    }
    const eye = () => (changes.eye ??= {})
    const parts = {
        plane: () => { changes.plane_m = metres() },
        gap: () => { changes.gap_m = metres() },
        exposure: () => { changes.exposure = plain() },
        laser: () => set("lasers", isOn()),
        power: () => set("powers", plain()),
        wavelength: () => set("wavelengths_m", metres()),
        pupil: () => { eye().pupil_m = metres() },
        pupil_x: () => { eye().pupil_x_m = metres() },
        pupil_y: () => { eye().pupil_y_m = metres() },
        chromatic: () => { eye().chromatic = isOn() },
        region: () => { changes.region = region() },
        view: () => { changes.view = text.replace("-", " ") },
        split: () => { changes.split = plain() },
    }
    if (!Object.hasOwn(parts, name)) refuse(`one of ${Object.keys(parts).join(", ")}`)
    parts[name]()
}

// The state of the page's address, or the first one; a link that can't be followed is said, until one can be.
// check: throws a Refusal for a state that can't be shown here.
function linkedState(bench, check = state => state) {
    const first = firstState(bench)
    try {
        $("link-note").textContent = ""
        return check(fromHash(location.hash, first, bench))
    } catch (error) {
        if (!(error instanceof Refusal)) throw error
        $("link-note").textContent = `This link can't be followed: ${error.message} The page shows its first state instead.`
        return first
    }
}
