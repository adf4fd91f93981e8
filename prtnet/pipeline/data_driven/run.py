"""A run of data-driven transfer that has no other method."""

from prtnet.config import STAGES
from prtnet.pipeline.data_driven.learn import operator
from prtnet.pipeline.job import Job


def run_alone(job: Job, sweep_point: str | None = None, sweep_command: str = "") -> None:
    """The stages of a run that has no other method: database and operator, files and page, score. Arguments as of
    `prtnet.pipeline.run`."""
    last = max(STAGES.index(stage) for stage in job.config.stages)
    made = operator(job)
    if last >= STAGES.index("export"):
        from prtnet.pipeline.data_driven import curves
        from prtnet.pipeline.data_driven.export import export

        curves.write(job, made)
        export(job, made)
        if job.config.export.web:
            from prtnet.pipeline.data_driven.page import write_page_of

            write_page_of(job, made)
    if "score" in job.config.stages:
        from prtnet.pipeline.data_driven.report import report
        from prtnet.pipeline.data_driven.score import score_lights

        report(job, made, score_lights(job, made))
        if sweep_point:
            from prtnet.pipeline.sweep import summarise

            summarise(job, sweep_point, sweep_command)
