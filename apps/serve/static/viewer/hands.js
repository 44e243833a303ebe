// Mouse, touch and keys turn, move and enlarge the cloud.

const TURN = 0.006;
const KEY_TURN = 0.08;
const KEY_PAN = 40;

export function follow(viewer) {
  const { canvas, camera } = viewer;
  const fingers = new Map();
  const scale = () => window.devicePixelRatio || 1;

  const spread = () => {
    const [a, b] = [...fingers.values()];
    return { distance: Math.hypot(a.x - b.x, a.y - b.y), x: (a.x + b.x) / 2, y: (a.y + b.y) / 2 };
  };

  canvas.addEventListener('pointerdown', (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    canvas.focus({ preventScroll: true });
  });

  canvas.addEventListener('pointermove', (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const [right, down] = [event.clientX - before.x, event.clientY - before.y];
    const now = { x: event.clientX, y: event.clientY };
    if (fingers.size === 2) {
      const was = spread();
      fingers.set(event.pointerId, now);
      const is = spread();
      camera.zoom(was.distance / Math.max(is.distance, 1));
      camera.pan((is.x - was.x) * scale(), (is.y - was.y) * scale());
    } else {
      fingers.set(event.pointerId, now);
      const moves = event.shiftKey || (event.buttons & 6) !== 0;
      if (moves) camera.pan(right * scale(), down * scale());
      else camera.turn(right * TURN, down * TURN);
    }
    viewer.redraw();
  });

  for (const end of ['pointerup', 'pointercancel']) {
    canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
  }
  canvas.addEventListener('contextmenu', (event) => event.preventDefault());

  canvas.addEventListener('wheel', (event) => {
    // The page scrolls past points that nobody has clicked.
    if (!event.ctrlKey && document.activeElement !== canvas && !document.fullscreenElement) return;
    event.preventDefault();
    camera.zoom(Math.exp(Math.sign(event.deltaY) * Math.min(Math.abs(event.deltaY), 200) * 0.001));
    viewer.redraw();
  }, { passive: false });

  canvas.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const ways = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    const way = ways[event.key];
    if (way && event.shiftKey) camera.pan(way[0] * KEY_PAN * scale(), way[1] * KEY_PAN * scale());
    else if (way) camera.turn(-way[0] * KEY_TURN, way[1] * KEY_TURN);
    else if (event.key === '+' || event.key === '=' || event.key === 'PageUp') camera.zoom(0.8);
    else if (event.key === '-' || event.key === 'PageDown') camera.zoom(1.25);
    else if (event.key === 'Home') viewer.home();
    else return;
    event.preventDefault();
    viewer.redraw();
  });
}
