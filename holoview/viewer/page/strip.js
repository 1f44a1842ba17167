// The strip: the drawing of the bench from the lasers to the eye. Its numbers follow the state; a reader chooses a part, and
// drags or types a length. What a page can't change is said. Places are those of the drawing (model/bench_drawing.py).

const DRAG_PIXELS = 300 // from one end of a length's range to the other
const NOT_ON_A_PAGE = "can't be changed on a page, whose shaders and tables were recorded for it; holoview view opens this file to edit it."
const SHORT_MM = metres => `${+(metres * 1e3).toPrecision(4)} mm`

// The lengths that a page can change, by their keys in the drawing: {name, range, of: a state, changes: of a state to a
// value, shown: in the drawing, of a state}. The drawing has planes from the last element, and spaces in a row as one.
function stripLengths(bench) {
    const { nominal_gap_m, eye, fixed } = bench
    const lengths = { planes: {
        name: "Focal plane", range: PAGE.plane_range_m, of: state => state.plane_m, changes: plane_m => ({ plane_m }),
        shown: state => state.plane_m - behindOf(bench, state),
        from: bench.behind?.spaces.length ? ["more from", state => `${SHORT_MM(behindOf(bench, state))} more from ${bench.behind.from}`] : null,
    } }
    for (const { name, key, relay, range_m } of bench.spaces ?? []) {
        const inRow = bench.spaces.filter(space => space.relay === relay)
        lengths[key] = {
            name, range: range_m, of: state => state.spaces[name], changes: length => ({ spaces: { [name]: length } }),
            shown: state => inRow.reduce((sum, space) => sum + state.spaces[space.name], 0),
        }
    }
    if (nominal_gap_m !== null) lengths.gap = { name: "Gap", range: PAGE.gap_range_m, of: state => state.gap_m, changes: gap_m => ({ gap_m }) }
    if (eye && !fixed.pupil) {
        lengths.eye = { name: "Pupil", range: PUPIL_RANGE_M, of: state => state.eye.pupil_m, changes: pupil_m => ({ eye: { pupil_m } }) }
    }
    return lengths
}

// Makes the parts of the drawing ones that can be chosen; returns what writes the state's numbers into it.
function connectStrip(viewer, change) {
    const svg = $("bench").querySelector("svg")
    const lengths = stripLengths(viewer.bench)
    const texts = [...svg.querySelectorAll("text[data-key]")]
    const parts = PAGE.bench_areas.map(([key, [left, top, right, bottom]], index) => {
        const room = shape(svg, "rect", { x: left, y: top, width: right - left, height: bottom - top, class: "part" })
        const labels = texts.filter(text => {
            const [x, y] = ["x", "y"].map(name => Number(text.getAttribute(name)))
            return x >= left && x <= right && y >= top && y <= bottom
        })
        return { key, index, room, labels, length: lengths[key] }
    })
    for (const part of parts) { // of several rooms of a key that of the length is reached by Tab
        const same = parts.filter(({ key }) => key === part.key)
        const isOfLength = ({ labels }) => labels.length === 1 && lengthOf(labels[0].textContent.split(" to ").at(-1)) !== null
        part.isFirst = (same.find(isOfLength) ?? same[0]) === part
        part.room.setAttribute("tabindex", part.isFirst ? 0 : -1)
        part.room.setAttribute("role", part.length ? "slider" : "button")
    }
    const field = $("part-length")
    let chosen = null
    const writeField = () => { field.value = SHORT_MM(chosen.length.of(viewer.state)) }
    const choose = part => {
        chosen = part
        parts.forEach(({ room }) => room.classList.toggle("chosen", room === part.room))
        if (part.length) writeField()
        update()
    }
    const setLength = (length, value) => {
        $("message").textContent = ""
        return change(length.changes(value)).then(update)
    }
    parts.forEach(part => connectPart(part, viewer, choose, setLength))
    field.addEventListener("change", () => {
        const value = lengthOf(field.value)
        if (value === null) $("message").textContent = `${chosen.length.name}: expected ${LENGTH_EXAMPLE}.`
        else setLength(chosen.length, value) // the state follows at once, or the message says why not; the image comes later
        writeField()
    })
    field.addEventListener("keydown", event => {
        if (event.key !== "Escape") return
        writeField() // what was typed is dropped, not set
        chosen.room.focus()
    })
    function update() {
        const { state } = viewer
        writeStrip(parts, state)
        $("part-row").hidden = !chosen?.length
        if (!chosen) return
        if (chosen.length) {
            $("part-name").textContent = chosen.length.name
            if (document.activeElement !== field) writeField() // an image that comes meanwhile leaves what is being typed
            $("part-note").textContent = `${chosen.length.range.map(SHORT_MM).join(" to ")}: type it, drag it in the drawing, or press ← and → there.`
        } else {
            const is = chosen.labels.map(label => label.textContent).join(", ")
            $("part-note").textContent = chosen.key === "wavelengths" ? `${is}: switched and changed under Lasers.` : `${is}: ${NOT_ON_A_PAGE}`
        }
    }
    return update
}

// Writes the state's numbers where the drawing has those of the file.
function writeStrip(parts, state) {
    const lit = state.wavelengths_m.filter((_, i) => state.lasers[i] && state.powers[i] > 0).map(λ => λ * 1e9)
    const count = state.wavelengths_m.length
    for (const { key, isFirst, room, labels, length } of parts) {
        if (key === "wavelengths") {
            labels[0].textContent = lit.length === count ? (count === 1 ? "laser" : `${count} lasers`) : `${lit.length} of ${count} lasers`
            const ends = [...new Set([Math.min(...lit), Math.max(...lit)].map(nm => +nm.toPrecision(4)))]
            labels[1].textContent = lit.length ? `${ends.join(" to ")} nm` : "all off"
        }
        if (length) {
            const value = length.of(state)
            if (key === "eye") labels[1].textContent = `pupil ${SHORT_MM(value)}`
            else if (isFirst) labels[0].textContent = SHORT_MM((length.shown ?? length.of)(state))
            const [words, text] = length.from ?? []
            for (const label of labels) if (words && label.textContent.includes(words)) label.textContent = text(state)
            const [low, high] = length.range.map(each => each * 1e3)
            const aria = { label: length.name, valuemin: low, valuemax: high, valuenow: value * 1e3, valuetext: SHORT_MM(value) }
            for (const [name, text] of Object.entries(aria)) room.setAttribute(`aria-${name}`, text)
        } else room.setAttribute("aria-label", labels.map(label => label.textContent).join(", "))
    }
}

// A part under a pointer and under the keyboard: chosen by a click, Enter or space; its length dragged, or stepped by arrows.
function connectPart(part, viewer, choose, setLength) {
    const { room, length } = part
    const within = value => Math.min(Math.max(value, length.range[0]), length.range[1])
    const share = () => length.range[1] - length.range[0]
    let start = null
    room.addEventListener("pointerdown", event => {
        room.setPointerCapture(event.pointerId)
        room.focus()
        choose(part)
        start = length ? { x: event.clientX, value: length.of(viewer.state) } : null
    })
    room.addEventListener("pointermove", event => {
        if (start && event.clientX !== start.x) setLength(length, within(start.value + ((event.clientX - start.x) / DRAG_PIXELS) * share()))
    })
    for (const name of ["pointerup", "pointercancel"]) room.addEventListener(name, () => { start = null })
    room.addEventListener("keydown", event => {
        const sign = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 }[event.key]
        const isChoice = event.key === "Enter" || event.key === " "
        if (event.ctrlKey || event.metaKey || event.altKey || !(isChoice || (sign && length))) return
        event.preventDefault()
        event.stopPropagation() // of the keys of the whole page
        choose(part)
        if (sign) setLength(length, within(length.of(viewer.state) + (sign * share()) / 100))
        else if (length) {
            const field = $("part-length")
            field.focus()
            field.select()
        }
    })
}
