// Of questions asked one after another, only the newest one's answer counts, in whatever order answers come.

export class Newest {
  private asked = 0;

  /** What a question came to; null where a newer one has been asked meanwhile. */
  async of<T>(answer: Promise<T>): Promise<T | null> {
    this.asked += 1;
    const mine = this.asked;
    const value = await answer;
    return mine === this.asked ? value : null;
  }
}
