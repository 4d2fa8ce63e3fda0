// What the robot's cameras see, drawn when they are asked to look, or again and again; and what the cameras of a rig took.

/** Time between two looks (ms). */
const PAUSE = 250;

/** Pictures side by side. */
export class Pictures {
  /** @param {HTMLElement} place */
  constructor(place) {
    this.place = place;
    this.clear();
  }

  clear() {
    /** @type {HTMLCanvasElement[]} */
    this.canvases = [];
    this.place.replaceChildren();
  }

  /** @param {import("./link.js").Picture} picture */
  draw({ index, count, width, height, pixels }) {
    if (this.canvases.length !== count) {
      this.canvases = Array.from({ length: count }, () => document.createElement("canvas"));
      this.place.replaceChildren(...this.canvases);
    }
    const canvas = this.canvases[index];
    Object.assign(canvas, { width, height, title: `camera ${index + 1}` });
    const image = new ImageData(width, height);
    for (let pixel = 0; pixel < width * height; pixel++) {
      image.data.set(pixels.subarray(3 * pixel, 3 * pixel + 3), 4 * pixel);
      image.data[4 * pixel + 3] = 255;
    }
    canvas.getContext("2d")?.putImageData(image, 0, 0);
  }
}

export class Cameras {
  /**
   * @param {{section: HTMLDetailsElement, pictures: HTMLElement, live: HTMLInputElement, look: HTMLButtonElement}} places
   * @param {() => void} ask
   */
  constructor(places, ask) {
    this.places = places;
    this.ask = ask;
    this.pictures = new Pictures(places.pictures);
    places.look.onclick = ask;
    places.live.onchange = () => { if (places.live.checked) ask(); };
    places.section.ontoggle = () => { if (places.section.open) ask(); };
  }

  /** @param {import("./link.js").Layout} layout */
  show(layout) {
    this.places.section.hidden = layout.cameras === 0;
    this.pictures.clear();
    if (this.places.section.open) this.ask();
  }

  /** @param {import("./link.js").Picture} picture */
  draw(picture) {
    this.pictures.draw(picture);
    if (picture.index < picture.count - 1) return;
    document.body.dataset.pictures = String(picture.count);
    const { live, section } = this.places;
    setTimeout(() => { if (live.checked && section.open) this.ask(); }, PAUSE);
  }
}
