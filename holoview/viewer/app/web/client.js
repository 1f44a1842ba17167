// The page's end of the connection: shows the frames that rendercanvas sends, sends the events of the view, and opens
// the connection again when it drops.

const RETRY_MS = 1000
const FULL_RETRY_MS = 5000
const NORMAL_CLOSURE = 1000 // RFC 6455, 7.4.1
const TRY_AGAIN_LATER = 1013
const NOT_USED = 4001 // holoview/viewer/app/serve.py
const wrapper = document.getElementById('canvas')
const status = document.getElementById('status')

class View extends window.BaseRenderView {
  constructor () {
    const image = document.createElement('img')
    image.decoding = 'sync'
    image.style.imageRendering = 'pixelated'
    image.style.touchAction = 'none'
    image.ondragstart = () => false
    super(image, wrapper)
    this._frames = []
    this._isDue = false
    image.onload = () => this._showNext()
    this._focusElement.focus({ preventScroll: true }) // keys and the wheel work before the first click
    window.addEventListener('focus', () => this._focusElement.focus({ preventScroll: true }))
  }

  onEvent (event) {
    if (event.type === 'resize') this._size = event
    send(event)
  }

  /** Tells the viewer what it missed while there was no connection. */
  restore () {
    if (this._size) this.onEvent(this._size)
    this.releaseKeys()
  }

  addFrame (frame) {
    this._frames.push(frame)
    this._showNext()
  }

  _showNext () {
    if (this._isDue || this._frames.length === 0) return
    this._isDue = true
    window.requestAnimationFrame(() => {
      this._isDue = false
      const frame = this._frames.shift()
      URL.revokeObjectURL(this.viewElement.src)
      this.viewElement.src = URL.createObjectURL(new Blob(frame.buffers, { type: frame.mimetype }))
      const { index, timestamp } = frame
      send({ type: '_framefeedback', index, timestamp, localtime: Date.now() / 1000 })
    })
  }
}

let socket = null
let view = null

function send (event) {
  if (socket !== null && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(event))
}

function tell (text, isStale = false) {
  status.textContent = text
  wrapper.classList.toggle('is-stale', isStale)
}

function receive (message) {
  if (message.type === 'framebufferdata') view.addFrame(message)
  else if (message.type === 'active') tell(message.value ? '' : 'Another page uses this viewer. Click to use it here.')
  else if (message.type === 'cursor') view.setCursor(message.value)
  else if (message.type === 'title') document.title = message.value
}

function connect () {
  const scheme = window.location.protocol === 'https:' ? 'wss://' : 'ws://'
  socket = new WebSocket(scheme + window.location.host + window.location.pathname)
  window.websocket = socket // tests close it
  let announced = null // a message whose buffers are still to come

  socket.onopen = () => {
    tell('')
    if (view === null) view = new View()
    else view.restore()
  }
  socket.onmessage = ({ data }) => {
    if (typeof data !== 'string') announced.buffers.push(data)
    else announced = { ...JSON.parse(data), buffers: [] }
    if (announced.buffers.length === (announced.nbuffers ?? 0)) receive(announced)
  }
  socket.onclose = ({ code, reason }) => {
    if (code === NORMAL_CLOSURE) {
      tell('The viewer was closed. You can close this page.', true)
    } else if (code === TRY_AGAIN_LATER) {
      tell(`There is no place: ${reason}. Trying again …`, true)
      window.setTimeout(connect, FULL_RETRY_MS)
    } else if (code === NOT_USED) {
      tell(`This page was disconnected: ${reason}. Click to go on.`, true)
      window.addEventListener('pointerdown', connect, { once: true })
    } else {
      tell('No connection to the viewer. Trying again …', true)
      window.setTimeout(connect, RETRY_MS)
    }
  }
}

connect()
