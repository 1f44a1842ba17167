// Replays a frame recording (holoview/viewer/page/frame_recording.py) on a WebGPU device. It knows no optics: buffers, pipelines
// and the order of dispatches are those that Python recorded.

// A message for the reader, as opposed to an error of this program.
class Refusal extends Error {}

// The contents of a buffer, as `pack_contents` stores them.
function unpack(part, data) {
    const bytes = data.subarray(part.offset, part.offset + part.bytes)
    const isDamaged = () => new Refusal("The hologram's data in this file are damaged: stored pictures are shown.")
    if (bytes.length !== part.bytes) throw isDamaged()
    if (part.kind === "raw") return bytes
    const table = new Uint32Array(bytes.slice(0, 4 * part.values).buffer)
    const rest = bytes.slice(4 * part.values)
    const codes = part.kind === "codes8" ? rest : new Uint16Array(rest.buffer)
    const words = new Uint32Array(codes.length)
    for (let i = 0; i < codes.length; i++) {
        if (codes[i] >= table.length) throw isDamaged()
        words[i] = table[codes[i]]
    }
    return new Uint8Array(words.buffer)
}

class FrameReplay {
    // Allocates, and begins to compile; `compiled` waits for it. Rejects with a Refusal where the device can't.
    static async open(device, head) {
        const replay = new FrameReplay()
        device.pushErrorScope("out-of-memory")
        device.pushErrorScope("validation")
        Object.assign(replay, { device, head, pipelines: [], byLabel: new Map(head.buffers.map((each, index) => [each.label, index])) })
        replay.buffers = head.buffers.map(({ label, size, usage }) => device.createBuffer({
            label, size, usage: (usage === "uniform" ? GPUBufferUsage.UNIFORM : GPUBufferUsage.STORAGE) |
                GPUBufferUsage.COPY_SRC | GPUBufferUsage.COPY_DST,
        }))
        const modules = head.codes.map(code => device.createShaderModule({ code }))
        const layouts = head.pipelines.map(each => each.groups.map(group => device.createBindGroupLayout({
            entries: group.map(([binding, type]) => ({ binding, visibility: GPUShaderStage.COMPUTE, buffer: { type } })),
        })))
        const pipelines = new Map() // some differ in their labels only
        replay.compiling = head.pipelines.map((each, index) => {
            const key = JSON.stringify([each.code, each.constants, each.groups])
            if (!pipelines.has(key)) pipelines.set(key, device.createComputePipelineAsync({
                label: each.label,
                layout: device.createPipelineLayout({ bindGroupLayouts: layouts[index] }),
                compute: { module: modules[each.code], entryPoint: "main", constants: each.constants },
            }))
            return pipelines.get(key).then(pipeline => { replay.pipelines[index] = pipeline })
        })
        replay.groups = head.bind_groups.map(each => device.createBindGroup({
            layout: layouts[each.pipeline][each.group],
            entries: each.entries.map(([binding, buffer]) => ({ binding, resource: { buffer: replay.buffers[buffer] } })),
        }))
        const wrong = device.popErrorScope()
        const memory = device.popErrorScope()
        Promise.all(replay.compiling).catch(() => {}) // reported by who waits for it, after what explains it
        if (await wrong) throw new Refusal(`This browser's WebGPU refuses the recorded frame: ${(await wrong).message}`)
        if (await memory) throw new Refusal("The graphics device has too little memory for this hologram.")
        return replay
    }

    // Waits until the pipelines of some steps, or of all, are compiled.
    async compiled(steps = this.head.steps) {
        const needed = new Set(steps.flatMap(({ dispatches }) => dispatches.map(([pipeline]) => pipeline)))
        await Promise.all([...needed].map(pipeline => this.compiling[pipeline]))
    }

    // Writes what buffers hold at first. contents, data: as `pack_contents` stores it.
    fill(contents, data) {
        const unpacked = new Map()
        const content = number => {
            if (!unpacked.has(number)) unpacked.set(number, unpack(contents[number], data))
            return unpacked.get(number)
        }
        this.content = number => unpack(contents[number], data)
        this.head.buffers.forEach((each, index) => {
            if (each.data !== null) this.device.queue.writeBuffer(this.buffers[index], 0, content(each.data))
        })
    }

    buffer(label) {
        return this.buffers[this.byLabel.get(label)]
    }

    // Overwrites a table from a byte offset on; recorded steps that read it see the new values.
    write(label, bytes, offset = 0) {
        this.device.queue.writeBuffer(this.buffer(label), offset, bytes)
    }

    // Submits steps of the recording, in order, once they are compiled.
    run(steps) {
        const encoder = this.device.createCommandEncoder()
        const pass = encoder.beginComputePass()
        for (const step of steps) {
            for (const [pipeline, groups, workgroups] of step.dispatches) {
                pass.setPipeline(this.pipelines[pipeline])
                for (const [number, group] of groups) pass.setBindGroup(number, this.groups[group])
                pass.dispatchWorkgroups(...workgroups)
            }
        }
        pass.end()
        this.device.queue.submit([encoder.finish()])
    }

    // The contents of a buffer, once all submitted work is done.
    async read(label) {
        const source = this.buffer(label)
        const target = this.device.createBuffer({ size: source.size, usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST })
        const encoder = this.device.createCommandEncoder()
        encoder.copyBufferToBuffer(source, 0, target, 0, source.size)
        this.device.queue.submit([encoder.finish()])
        await target.mapAsync(GPUMapMode.READ)
        const bytes = new Uint8Array(target.getMappedRange().slice(0))
        target.destroy()
        return bytes
    }
}
