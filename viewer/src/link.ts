// State in the address: what is shown, so that a link shows the same.

/** Values by name. */
export class Link {
  private readonly values = new URLSearchParams(location.hash.slice(1));
  private pending = 0;

  text(name: string, otherwise: string): string {
    return this.values.get(name) ?? otherwise;
  }

  number(name: string, otherwise: number): number {
    const value = Number(this.values.get(name) ?? NaN);
    return Number.isFinite(value) ? value : otherwise;
  }

  /** Sets a value. The address follows a little later: browsers limit how often it may change. */
  set(name: string, value: string | number): void {
    this.values.set(name, String(value));
    clearTimeout(this.pending);
    this.pending = window.setTimeout(() => history.replaceState(null, "", "#" + this.values), 200);
  }
}
