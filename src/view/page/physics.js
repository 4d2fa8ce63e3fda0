// How the robot follows its tendons: at rest, with friction in their holes, or in motion.

/** Coefficient of friction where the robot's file says none. */
const USUAL = 0.1;

export class PhysicsChoice {
  /**
   * @param {{choice: HTMLElement, row: HTMLElement, friction: HTMLInputElement, value: HTMLElement}} places
   * @param {(physics: import("./link.js").Physics, coefficient: number) => void} chosen
   */
  constructor(places, chosen) {
    this.places = places;
    this.choices = [...places.choice.querySelectorAll("input")];
    const tell = () => {
      const { value } = this.choices.find((one) => one.checked);
      chosen(/** @type {import("./link.js").Physics} */ (value), places.friction.valueAsNumber);
    };
    for (const one of this.choices) one.addEventListener("change", tell);
    places.friction.addEventListener("change", tell);
    places.friction.addEventListener("input", () => this.label());
  }

  /** @param {import("./link.js").Layout} layout */
  show(layout) {
    this.places.friction.valueAsNumber = layout.friction ?? USUAL;
    this.label();
  }

  /** @param {import("./link.js").Frame} frame */
  move({ physics }) {
    for (const one of this.choices) one.checked = one.value === physics;
    this.places.row.hidden = physics !== "with_friction";
  }

  label() {
    this.places.value.textContent = this.places.friction.valueAsNumber.toFixed(2);
  }
}
