// SPDX-License-Identifier: GPL-3.0-or-later
// A job type for Blender's render farm Flamenco: a test set of the laboratory (`run_dgs.py synthesize`), a few photos in
// each task, and what is done once for a set at the end. Copy this file into the folder `scripts` beside
// flamenco-manager; workers need this repository (or its copy) at PROGRAM and the folder at OUT.

const JOB_TYPE = {
    label: "DGS Test Set",
    description: "Photos of a known object through something that blurs, with the sharp truth and the cameras",
    settings: [
        { key: "program", type: "string", subtype: "file_path", required: true,
          description: "run_dgs.py, where the workers see it" },
        { key: "out", type: "string", subtype: "dir_path", required: true,
          description: "Folder of the set, shared by all workers" },
        { key: "views", type: "int32", required: true, default: 48, propargs: { min: 2, max: 100000 },
          description: "Number of photos" },
        { key: "words", type: "string", required: false, default: "--scene village --path drone --size 800x600 --psf none",
          description: "More options of 'run_dgs.py synthesize'; no spaces inside one" },
        { key: "chunk_size", type: "int32", default: 4, propargs: { min: 1, max: 1000 }, visible: "submission",
          description: "Photos of one task" },
    ]
};

function compileJob(job) {
    const settings = job.settings;
    const words = (settings.words || "").split(" ").filter((word) => word.length > 0);
    if (words.some((word) => word === "--views" || word === "--out" || word === "--frames"))
        throw "--views, --out and --frames are settings of their own here";
    const finish = author.Task("finish", "blender");
    finish.addCommand(command(settings, words));
    for (const chunk of frameChunker(`0-${settings.views - 1}`, settings.chunk_size)) {
        const render = author.Task(`photos-${chunk}`, "blender");
        render.addCommand(command(settings, [...words, "--frames", chunk]));
        job.addTask(render);
        finish.addDependency(render);
    }
    job.addTask(finish);
}

// `blender -b -P run_dgs.py -- synthesize ...`: the same command that a terminal takes.
function command(settings, words) {
    return author.Command("exec", {
        exe: "{blender}",
        args: ["-b", "--python-exit-code", "1", "-P", settings.program, "--",
               "synthesize", "--out", settings.out, "--views", `${settings.views}`, ...words],
    });
}
