// SPDX-License-Identifier: GPL-3.0-or-later
// What Flamenco Manager gives a job compiler script, as far as ours may use it, written from Flamenco's documentation.
// Every mistake that Flamenco would refuse throws here.

const refuse = (message) => { throw new Error(message); };
const print = () => {};
const alert = () => {};

// Text of a type that Flamenco's Go code would refuse, where it gets another one
const text = (value, name) => typeof value === "string" ? value : refuse(`${name}: not a text: ${value}`);

const author = {
    Task(name, type) {
        if (!text(name, "name").trim() || !text(type, "type").trim()) refuse("a task needs a name and a type");
        return {
            name, type, commands: [], dependencies: [],
            addCommand(command) { this.commands.push(command); },
            addDependency(task) { this.dependencies.push(task.name); },
        };
    },
    Command(name, parameters) { return { name, parameters }; },
};

const path = {
    join: (...parts) => parts.join("/").replace(/\/+/g, "/"),
    basename: (whole) => whole.split("/").pop(),
    dirname: (whole) => whole.split("/").slice(0, -1).join("/") || ".",
    stem: (whole) => path.basename(whole).replace(/\.[^.]*$/, ""),
};

const formatTimestampLocal = (moment) => moment.toISOString().slice(0, 19).replace("T", "_").replace(/:/g, "");

const readFrame = (words) => /^\s*\d+\s*$/.test(words) ? Number(words) : refuse(`invalid range: ${words}`);

// Frames without steps and without negative numbers: Flamenco knows no others.
function explode(range) {
    const frames = new Set();
    for (const part of text(range, "frames").replace(/\.\./g, "-").split(",")) {
        const ends = part.split("-").map(readFrame);
        if (ends.length > 2) refuse(`invalid range: ${part}`);
        for (let frame = ends[0]; frame <= ends[ends.length - 1]; frame++) frames.add(frame);
    }
    return [...frames].sort((a, b) => a - b);
}

// Runs of three and more as A-B, others as single numbers
function mergeFrames(frames) {
    const parts = [];
    for (let begin = 0, end; begin < frames.length; begin = end) {
        for (end = begin + 1; end < frames.length && frames[end] === frames[end - 1] + 1;) end++;
        if (end - begin > 2) parts.push(`${frames[begin]}-${frames[end - 1]}`);
        else parts.push(...frames.slice(begin, end));
    }
    return parts.join(",");
}

function frameChunker(range, size) {
    if (!(size >= 1)) refuse(`invalid chunk size: ${size}`);
    const frames = explode(range), chunks = [];
    for (let at = 0; at < frames.length; at += size) chunks.push(mergeFrames(frames.slice(at, at + size)));
    return chunks.length ? chunks : refuse("empty range");
}

const frameCount = (range) => explode(range).length;

// Compile a job as Flamenco Manager does, and return its tasks, as JSON.
function compile(settingsText) {
    const tasks = [];
    const job = {
        name: "a job", priority: 50, created: new Date(Date.UTC(2024, 1, 29, 12, 30, 5)),
        settings: JSON.parse(settingsText),
        // A copy: what is done to the task later is lost
        addTask(task) { tasks.push(JSON.parse(JSON.stringify(task))); },
    };
    compileJob(job);
    return JSON.stringify({ settings: job.settings, tasks });
}
