"""The terms of missions."""

from linked_fleet_gateway.extensions.rules.template import LF as RULES
from linked_fleet_rdf.vocabulary import RDF

LF = RULES.extended(
    "Mission MissionList MissionInput MissionShape MissionRun MissionRunList MissionRunListShape MissionRunShape"
    " RunMission Parameter InvokeStep SequenceStep ParallelStep FirstOfStep RepeatStep WaitStep ConfirmStep NotifyStep"
    " StepRun missions missionRuns parameter parameterType minimum maximum default option step steps kind actsOn"
    " anySuffices times seconds until within text holds mission stepRun stepPath attempt note confirmed"
    " StepRehearsal stepRehearsal PauseRun ResumeRun RetryStep SkipStep AnswerStep paused blocked ending skipped"
    " starting number wholeNumber truth textValue thing MissionBuilder MissionBuilderShape PlannedStep plannedStep"
)
JSON = RDF.iri + "JSON"
"""The datatype of bodies in plain JSON (JSON-LD 1.1, 10.2)."""
