// Processor time of everything that this process has started, seconds; from Linux's /proc.

import { readFileSync, readdirSync } from "node:fs";

const TICKS_PER_SECOND = 100;

export function browserSeconds() {
  const parents = new Map();
  const ticks = new Map();
  for (const name of readdirSync("/proc").filter((entry) => /^[0-9]+$/.test(entry))) {
    let text;
    try { text = readFileSync(`/proc/${name}/stat`, "utf8"); } catch { continue; }
    // The name of the program may hold spaces: fields are counted after it.
    const fields = text.slice(text.lastIndexOf(")") + 2).split(" ");
    parents.set(Number(name), Number(fields[1]));
    ticks.set(Number(name), Number(fields[11]) + Number(fields[12]));
  }
  const isOurs = (pid) => {
    let at = parents.get(pid);
    while (at && at !== process.pid) at = parents.get(at);
    return at === process.pid;
  };
  return [...ticks].filter(([pid]) => isOurs(pid)).reduce((sum, [, n]) => sum + n, 0) / TICKS_PER_SECOND;
}
