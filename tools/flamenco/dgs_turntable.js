// SPDX-License-Identifier: GPL-3.0-or-later
// A job type for Blender's render farm Flamenco: frames of an animation with twins, such as a turntable, rendered by the
// engine that the scene has (Descatter, Cycles or EEVEE), and a film of them. Copy this file into the folder `scripts`
// beside flamenco-manager. Where the engine is Descatter, workers' Blenders need the add-on installed, with its engine.

const JOB_TYPE = {
    label: "DGS Turntable",
    description: "Frames of a scene with twins, and a film of them",
    settings: [
        { key: "frames", type: "string", required: true, eval: "f'{C.scene.frame_start}-{C.scene.frame_end}'",
          description: "Such as 1-100" },
        { key: "out", type: "string", subtype: "dir_path", required: true,
          description: "Folder of the frames, shared by all workers" },
        { key: "chunk_size", type: "int32", default: 10, propargs: { min: 1, max: 1000 }, visible: "submission",
          description: "Frames of one task; a task starts Blender and the twin's renderer once" },
        { key: "film", type: "bool", required: false, default: true, description: "Make a film of the frames, too" },
        { key: "blendfile", type: "string", required: true, visible: "web", description: "The scene" },
        { key: "fps", type: "float", eval: "C.scene.render.fps / C.scene.render.fps_base", visible: "hidden" },
    ]
};

function compileJob(job) {
    const settings = job.settings;
    const renders = frameChunker(settings.frames, settings.chunk_size).map((chunk) => {
        const render = author.Task(`frames-${chunk}`, "blender");
        render.addCommand(author.Command("blender-render", {
            exe: "{blender}",
            exeArgs: "{blenderArgs}",
            argsBefore: ["--python-exit-code", "1"],
            blendfile: settings.blendfile,
            args: ["--render-output", path.join(settings.out, "######"), "--render-format", "PNG",
                   "--render-frame", chunk.replace("-", "..")],
        }));
        job.addTask(render);
        return render;
    });
    if (!settings.film)
        return;
    const film = author.Task("film", "ffmpeg");
    film.addCommand(author.Command("frames-to-video", {
        exe: "ffmpeg",
        fps: settings.fps,
        inputGlob: path.join(settings.out, "*.png"),
        outputFile: path.join(settings.out, "turntable.mp4"),
        args: ["-c:v", "h264", "-crf", "18", "-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p",
               "-r", `${settings.fps}`, "-y"],
    }));
    for (const render of renders)
        film.addDependency(render);
    job.addTask(film);
}
