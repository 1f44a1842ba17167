// Opens the device and compiles the first hologram's first recording, while the browser still reads the rest of the file.

const $ = id => document.getElementById(id)

// The bytes of base64 of deflated data.
async function inflate(base64) {
    const bytes = Uint8Array.fromBase64 ? Uint8Array.fromBase64(base64) : Uint8Array.from(atob(base64), each => each.charCodeAt(0))
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"))
    return new Uint8Array(await new Response(stream).arrayBuffer())
}

const readHeads = async i => JSON.parse(new TextDecoder().decode(await inflate($(`holoview-frames-${i}`).textContent)))

async function openDevice() {
    if (!navigator.gpu) {
        throw new Refusal("This browser has no WebGPU, so the hologram can't be computed here: stored pictures are shown. " +
            "Chrome and Edge have it, Safari from version 26, Firefox on some systems.")
    }
    const adapter = await navigator.gpu.requestAdapter({ powerPreference: "high-performance" })
    if (!adapter) {
        throw new Refusal("This browser has WebGPU, but no graphics device for it: stored pictures are shown. " +
            "Switching on hardware acceleration in the browser's settings may help.")
    }
    const most = adapter.limits.maxComputeWorkgroupStorageSize
    return [await adapter.requestDevice({ requiredLimits: { maxComputeWorkgroupStorageSize: most } }), adapter.info]
}

// Whether a device has the workgroup memory that a recording needs; all else are WebGPU's default limits.
const suits = (device, head) => head.limits["max-compute-workgroup-storage-size"] <= device.limits.maxComputeWorkgroupStorageSize

// Adapters that compute on the processor: there, long shaders take minutes to compile and are slower.
const isSoftware = info => info.isFallbackAdapter || /swiftshader|llvmpipe|basic render|warp/i.test(`${info.architecture} ${info.description}`)

// {device, info, heads, first: the recording that is compiled first, replay: a promise of it}
const opening = (async () => {
    const [[device, info], heads] = await Promise.all([openDevice(), readHeads(0)])
    const first = (isSoftware(info) && heads.find(head => head.is_quick)) || heads.find(head => !head.is_quick)
    return { device, info, heads, first, replay: FrameReplay.open(device, first) }
})()
opening.catch(() => {})
