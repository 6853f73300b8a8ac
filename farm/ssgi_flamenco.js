// SPDX-License-Identifier: GPL-3.0-or-later
// A job type for Flamenco 3: lay this file into the folder `scripts` beside flamenco-manager.
// The workers' Blender needs the extension. docs/farms.md says how it is used.

const JOB_TYPE = {
    label: "Screen-Space GI",
    description: "Frames with indirect light, and a report of the shot",
    settings: [
        { key: "frames", type: "string", required: true,
          eval: "f'{C.scene.frame_start}-{C.scene.frame_end}'",
          evalInfo: { showLinkButton: true, description: "The scene's frame range" },
          description: "Frames to render: numbers and ranges with commas between them, such as 1-4,7,9-12" },
        { key: "chunk_size", type: "int32", default: 4, propargs: { min: 1 }, visible: "submission",
          label: "Frames per Task",
          description: "Frames that one task renders. Each task starts Blender and loads the scene once" },

        { key: "preset", type: "string", choices: ["draft", "balanced", "final"], default: "balanced",
          description: "The point between speed and accuracy" },
        { key: "resolution", type: "string", default: "",
          description: "Width and height in pixels, such as 960x540. Empty: the scene's own" },
        { key: "further_settings", type: "string", default: "",
          description: "More settings as on the command line, such as --engine eevee --rays 16" },
        { key: "render_options", type: "string", default: "",
          description: "Options of the frames alone, such as --passes" },
        { key: "prepare_options", type: "string", default: "",
          description: "Options of the preparation alone, such as --keys 9" },
        { key: "prepare", type: "bool", default: true, label: "Prepare the Shot",
          description: "Capture once what belongs to the whole shot. Off, every frame renders alone" },

        { key: "output_root", type: "string", subtype: "dir_path", required: true, visible: "submission",
          description: "Folder that all workers share. The job gets a folder of its own in it" },
        { key: "output_path", type: "string", subtype: "dir_path", editable: false,
          eval: "str(Path(abspath(settings.output_root), jobname, '{timestamp}'))",
          description: "Where the results will be" },

        // The add-on fills this one in by itself.
        { key: "blendfile", type: "string", required: true, visible: "web", description: "The scene" },
    ],
};

function compileJob(job) {
    const settings = withDefaults(job.settings);
    // Kept in the job, so that its page shows where the results are
    settings.output_path = settings.output_path.replace("{timestamp}", formatTimestampLocal(job.created));
    const chunks = frameChunker(settings.frames, settings.chunk_size);
    const allFrames = frameChunker(settings.frames, 1000000000)[0];
    const shot = path.join(settings.output_path, "shot");

    // Flamenco keeps a task as it is when it is added: dependencies come first.
    let prepareTask = null;
    if (settings.prepare) {
        prepareTask = ssgiTask("prepare", settings, pictureWords("prepare", settings, shot, allFrames)
            .concat(wordsOf(settings.prepare_options)));
        job.addTask(prepareTask);
    }
    const reportTask = ssgiTask("report", settings, [
        "merge", settings.output_path, "--frames", allFrames, "--progress", "lines",
    ]);
    for (const chunk of chunks) {
        let words = pictureWords("render", settings, settings.output_path, chunk)
            .concat(wordsOf(settings.render_options));
        if (prepareTask) {
            words = words.concat(["--shot", shot]);
        }
        const task = ssgiTask(`render-${chunk}`, settings, words);
        if (prepareTask) {
            task.addDependency(prepareTask);
        }
        job.addTask(task);
        reportTask.addDependency(task);
    }
    job.addTask(reportTask);
}

// Jobs that do not come from the add-on may lack settings.
function withDefaults(settings) {
    for (const setting of JOB_TYPE.settings) {
        if (settings[setting.key] === undefined && setting.default !== undefined) {
            settings[setting.key] = setting.default;
        }
    }
    return settings;
}

// Paths stand alone, never behind a "=": Flamenco translates them between platforms by how a word begins.
function pictureWords(command, settings, output, frames) {
    let words = [
        command, "--output", output, "--frames", frames, "--preset", settings.preset, "--progress", "lines",
    ];
    if (settings.resolution) {
        words = words.concat(["--resolution", settings.resolution]);
    }
    return words.concat(wordsOf(settings.further_settings));
}

function wordsOf(text) {
    return text.split(/\s+/).filter(word => word);
}

// This kind of command finds Blender on all platforms. It opens the scene, which then need not be named.
function ssgiTask(name, settings, words) {
    const task = author.Task(name, "blender");
    task.addCommand(author.Command("blender-render", {
        exe: "{blender}",
        exeArgs: "{blenderArgs}",
        argsBefore: ["--background"],
        blendfile: settings.blendfile,
        args: ["--command", "ssgi"].concat(words),
    }));
    return task;
}
