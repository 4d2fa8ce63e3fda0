// The robot's file, checked as it is typed, with its error beside the line of the field.

/** Time that the editor waits for the next key (ms). */
const TYPED = 300;

/**
 * The line (from 0) of a TOML text that an error is about: the one that it names, or that of the field that it names, such as
 * `modules[1].pitch`. The table's own line where the field is not in it, and -1 where nothing is found.
 * @param {string} text
 * @param {string} reason
 */
export function lineOf(text, reason) {
  const named = /at line (\d+)/.exec(reason);
  if (named !== null) return Number(named[1]) - 1;
  const field = /`([a-z_]+(?:\[\d+\])?(?:\.[a-z_]+(?:\[\d+\])?)*)`/.exec(reason);
  if (field === null) return -1;
  const lines = text.split("\n");
  let [from, end, found] = [0, lines.length, -1];
  for (const part of field[1].split(".")) {
    const [, name, number] = /([a-z_]+)(?:\[(\d+)\])?/.exec(part);
    const within = lines.map((line, place) => ({ line, place })).slice(from, end);
    // A table (of a list of them, the one of that number), or a key.
    const table = within.filter(({ line }) => new RegExp(`^\\s*\\[+(?:[a-z_]+\\.)*${name}\\]+\\s*$`).test(line))[Number(number ?? 0)];
    const key = within.find(({ line }) => new RegExp(`(?:^\\s*|[{,]\\s*)${name}\\s*=`).test(line));
    if (table !== undefined) {
      found = table.place;
      from = found + 1;
      const next = lines.findIndex((line, place) => place >= from && new RegExp(`^\\s*\\[\\[?${name}\\]`).test(line));
      end = next < 0 ? lines.length : next;
    } else if (key !== undefined) {
      found = key.place;
      [from, end] = [found, found + 1];
    } else return found;
  }
  return found;
}

export class RobotFile {
  /**
   * @param {{text: HTMLTextAreaElement, error: HTMLElement, mark: HTMLElement, section: HTMLDetailsElement}} places
   * @param {(toml: string) => void} typed
   */
  constructor(places, typed) {
    this.places = places;
    this.isEdited = false;
    this.line = -1;
    /** @type {number | undefined} */
    let waiting;
    places.text.addEventListener("input", () => {
      this.isEdited = true;
      clearTimeout(waiting);
      waiting = setTimeout(() => typed(places.text.value), TYPED);
    });
    places.text.addEventListener("scroll", () => this.place());
    new ResizeObserver(() => this.place()).observe(places.text);
  }

  /** @param {string | null} toml */
  show(toml) {
    if (!this.isEdited) this.places.text.value = toml ?? "";
    this.line = -1;
    this.places.error.hidden = true;
    this.place();
  }

  /** @param {string} reason */
  refuse(reason) {
    const { text, error, section } = this.places;
    error.textContent = reason;
    error.hidden = false;
    section.open = true;
    this.line = lineOf(text.value, reason);
    document.body.dataset.wrongLine = String(this.line);
    this.place();
  }

  /** Puts the mark beside the wrong line. */
  place() {
    const { text, mark, error } = this.places;
    const style = getComputedStyle(text);
    const [height, padding] = [parseFloat(style.lineHeight), parseFloat(style.paddingTop)];
    const top = padding + this.line * height - text.scrollTop;
    mark.hidden = this.line < 0 || top < -height / 2 || top > text.clientHeight - height / 2;
    mark.style.top = `${text.offsetTop + text.clientTop + top}px`;
    mark.style.height = `${height}px`;
    mark.title = error.textContent ?? "";
  }
}
