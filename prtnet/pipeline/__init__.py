"""The stages of a run, in order: bake, size, train, export, score. Each result is kept under a hash of its inputs.

`stages` names what is wanted; what the wanted needs is made as well where it is missing. The same command again finds
everything and only prints. `size` is made only where it is named, and chooses the network of the stages after it.
`view` comes last, and only where it is named: a window on what was exported.
"""

from prtnet.config import STAGES, Config


def run(config: Config, command: str = "", sweep_point: str | None = None, sweep_command: str = "") -> None:
    """Run a job. `command` is shown in its report; a point of a sweep gets a folder of its own
    and joins the summary in the folder above, which says the whole sweep's command.

    Raises PrtnetError for whatever the user can mend.
    """
    # each stage imports what it needs, so that `stages=[bake]` never waits for torch
    from prtnet.pipeline import engine
    from prtnet.pipeline.bake import bake
    from prtnet.pipeline.data_driven import options
    from prtnet.pipeline.job import open_job

    engine.check(config.cluster)
    job = open_job(config, command, sweep_point)
    config = job.config  # with the methods of the scene where none were named
    if options.alone(config):
        from prtnet.pipeline.data_driven.run import run_alone

        run_alone(job, sweep_point, sweep_command)
        return
    last = max(STAGES.index(stage) for stage in config.stages)
    baked = bake(job)
    network = clusters = None
    if baked.points and "clusters" in config.methods and last >= STAGES.index("size"):
        from prtnet.pipeline.clusters import train_clusters

        clusters = train_clusters(job, baked.points, baked)
    if "size" in config.stages and "net" in config.methods:
        from prtnet.pipeline.size import size

        job = size(job, baked)
    if baked.points and "net" in config.methods and last >= STAGES.index("train"):
        from prtnet.pipeline.train import train, train_as_job

        train_as_job(job, baked.points)
        network = train(job, baked.points)
    if last >= STAGES.index("export"):
        from prtnet.pipeline.export import export

        exported = export(job, baked, network, clusters)
        if "score" in config.stages:
            from prtnet.pipeline.pictures import write_pictures
            from prtnet.pipeline.report import report
            from prtnet.pipeline.score import score_methods

            scored = score_methods(job, baked, network, exported)
            write_pictures(job, baked, network, exported, scored)
            report(job, baked, network, exported, scored)
            if sweep_point:
                from prtnet.pipeline.sweep import log_point, summarise

                if network:
                    log_point(job, sweep_point, scored, network)
                summarise(job, sweep_point, sweep_command)
        if "view" in config.stages:
            from prtnet.pipeline.view import view

            view(job, baked, network, exported)
