// What the program prints, as its JSON: values that the page has no part in.
import { execFileSync } from "node:child_process";

const program = process.env.PLYWAVE ?? new URL("../../target/release/plywave", import.meta.url).pathname;

/** The JSON that a command prints. */
export function printed(...words) {
  return JSON.parse(execFileSync(program, [...words.map(String), "--json"], { encoding: "utf8", stdio: ["ignore", "pipe", "pipe"], maxBuffer: 1 << 28 }));
}
