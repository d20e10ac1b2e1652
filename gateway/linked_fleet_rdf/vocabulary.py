"""Every vocabulary IRI that the gateway emits or understands, spelt here and nowhere else.

The namespaces are closed: a term that is not listed raises AttributeError, so that a typo cannot become data. Terms of
``ros`` and ``hybrit`` are those of the paper and its authors' implementation. Terms missing from all vocabularies are
in ``lf`` and described in shapes/linked_fleet_shapes/vocabulary.ttl. Extensions add terms of their own to ``lf``.
"""

from linked_fleet_shacl.terms import Namespace

RDF = Namespace(
    "http://www.w3.org/1999/02/22-rdf-syntax-ns#", "type first rest nil Property Statement predicate object"
)
RDFS = Namespace("http://www.w3.org/2000/01/rdf-schema#", "seeAlso label comment Class subClassOf")
OWL = Namespace("http://www.w3.org/2002/07/owl#", "Ontology")
XSD = Namespace(
    "http://www.w3.org/2001/XMLSchema#",
    "float double decimal integer int long short byte nonNegativeInteger positiveInteger "
    "nonPositiveInteger negativeInteger unsignedLong unsignedInt unsignedShort unsignedByte"
    " boolean string dateTime date time duration dayTimeDuration anyURI",
)
NUMERIC = (
    XSD.float, XSD.double, XSD.decimal, XSD.integer, XSD.int, XSD.long, XSD.short, XSD.byte,
    XSD.nonNegativeInteger, XSD.positiveInteger, XSD.nonPositiveInteger, XSD.negativeInteger,
    XSD.unsignedLong, XSD.unsignedInt, XSD.unsignedShort, XSD.unsignedByte,
)  # fmt: skip
"""Datatypes of numbers accepted in bodies: 43.6 is a decimal in Turtle, a double in JSON-LD."""
INTEGERS = NUMERIC[3:]
DCTERMS = Namespace("http://purl.org/dc/terms/", "title description identifier hasPart isPartOf format created")
LDP = Namespace(
    "http://www.w3.org/ns/ldp#",
    "Resource RDFSource NonRDFSource Container BasicContainer contains constrainedBy"
    " PreferContainment PreferMembership PreferMinimalContainer",
)
SH = Namespace(
    "http://www.w3.org/ns/shacl#",
    "NodeShape PropertyShape property path targetClass targetNode minCount maxCount datatype minInclusive"
    " minExclusive maxInclusive maxExclusive minLength maxLength nodeKind IRI in hasValue or and class alternativePath"
    " node name description"
    " SPARQLSelectExecutable select"
    " result focusNode resultPath value resultMessage sourceConstraintComponent",
)
PROV = Namespace(
    "http://www.w3.org/ns/prov#", "Activity Agent startedAtTime endedAtTime wasAssociatedWith used generated"
)
SOSA = Namespace(
    "http://www.w3.org/ns/sosa/",
    "ObservationCollection Observation hasMember hasFeatureOfInterest observedProperty hasResult hasSimpleResult"
    " resultTime Sensor isHostedBy hosts ObservableProperty Actuation actsOnProperty",
)
QUDT = Namespace("http://qudt.org/schema/qudt/", "unit")
UNIT = Namespace(
    "http://qudt.org/vocab/unit/",
    "RAD DEG M MilliM SEC NanoSEC KiloGM N N-M RAD-PER-SEC DEG-PER-SEC M-PER-SEC MilliM-PER-SEC"
    " KiloGM-M2 N-M-SEC-PER-RAD N-SEC-PER-M UNITLESS HZ",
)
HYDRA = Namespace(
    "http://www.w3.org/ns/hydra/core#",
    "IriTemplate IriTemplateMapping template mapping variable property required search view next previous",
)
SD = Namespace(
    "http://www.w3.org/ns/sparql-service-description#",
    "Service endpoint supportedLanguage SPARQL11Query resultFormat feature UnionDefaultGraph extensionFunction"
    " defaultDataset Dataset defaultGraph Graph namedGraph NamedGraph name graph",
)
FORMAT = Namespace(
    "http://www.w3.org/ns/formats/",
    "SPARQL_Results_JSON SPARQL_Results_XML SPARQL_Results_CSV SPARQL_Results_TSV Turtle JSON-LD N-Triples RDF_XML",
)
VOID = Namespace("http://rdfs.org/ns/void#", "Dataset triples sparqlEndpoint uriSpace vocabulary")
XHV = Namespace("http://www.w3.org/1999/xhtml/vocab#", "prev next")
HYBRIT = Namespace(
    "https://hybr-it-projekt.de/ns/hybr-it#",
    "RoboticThing Property Action AsynchronousAction property action subscriptions blueprint consumes produces binding"
    " Subscription WebCallback onResource callbackURL callbackUrl mediaType",
)
ROS = Namespace(
    "http://ros.org/#",
    "RevoluteJoint RevoluteJointShape Link rotation friction jointReferenceFrame preceedingLink succeedingLink",
)
VOM = Namespace("http://vocab.arvida.de/2015/06/vom/vocab#", "numericalValue unit Degree Radian")
MATHS = Namespace(
    "http://vocab.arvida.de/2015/06/maths/vocab#",
    "Scalar Vector3D x y z Radian Degree CoordinateSystem CoordinateSystemShape",
)
SPATIAL = Namespace(
    "http://vocab.arvida.de/2015/06/spatial/vocab#",
    "AxisAngle Rotation3D rotationAngle rotationAxis AxisAngleShape",
)
HTTP = Namespace("http://www.w3.org/2011/http#", "Request Body mthd requestURI body")
METHODS = Namespace("http://www.w3.org/2011/http-methods#", "POST PUT")
LF = Namespace(
    "https://w3id.org/linked-fleet#",
    # classes
    "Fleet Robot Joint ContinuousJoint PrismaticJoint FixedJoint FloatingJoint PlanarJoint Invocation Blueprint"
    " ScalarProperty Translation Limits Pose Twist Point Inertia Mimicry JointState JointSample FrameLayout FrameField"
    " Quaternion Problem Stream WebSocketStream EventStream ActionKind Rehearsal ControlLease TextProperty"
    " SpeedScale Annotations NamedPose JointTargets JointTrajectory TargetPosition"
    # kinds of actions
    " Rotate RotateBy Translate TranslateBy Hold MoveJoints FollowTrajectory AssumePose StopRobot StopAll"
    " CancelInvocation"
    # shapes
    " FleetShape RobotShape LinkShape ContinuousJointShape PrismaticJointShape FixedJointShape FloatingJointShape"
    " PlanarJointShape ScalarPropertyShape TranslationShape LimitsShape PoseShape TwistShape PointShape InertiaShape"
    " MimicryShape JointStateShape InvocationShape RehearsalShape SubscriptionShape SubscriptionResourceShape"
    " ActionShape"
    " ContainerShape MemberShape"
    " ControlLeaseShape ControlLeaseInput TextPropertyShape TextInput AnnotationsShape SpeedScaleShape SpeedScaleInput"
    " TargetPositionShape FrameLayoutShape"
    # individuals
    " unknown online offline faulty accepted running succeeded failed cancelled preempted free held"
    " thisAlone withProperties wholeSubtree active"
    " waiting awaitingConsent failing suspended"
    # predicates: things
    " isStop output presence lastSeen lastFrame fault finding outOfLimits derivedFrom unchecked ofLink meshUri"
    " rootLink baseMobility parentJoint childJoint shape invocations state reason"
    " target ofJoint result status vocabulary"
    # predicates: kinds of actions, and what completes their shapes
    " segment offeredBy offeredIf isBounded isCommandable hasCommandableJoint hasMovedLink hasNamedPose"
    " hasFloatingBase hasPathFollower needsRight"
    " capability completedBy anyNumber jointPosition jointDisplacement jointSpeed jointTarget"
    " jointExpectation ownLease ownLink ownPose dryRun"
    # predicates: what actions take and invocations tell
    " speed speedScale precondition tolerance tiedTo waypoint atTime poseName namedPose input duration progress"
    " preempts preemptedBy limitedBecause plannedBecause pathDeviation positionResidual orientationResidual answer"
    " ofRobot currentTask closest clearance uncertainty nearTo share plan leastManipulability"
    " leastManipulabilityTime"
    " lastMoved moving linkQuality modelName batteryCharge agentStatement InvocationList"
    # predicates: control and settings
    " lease holder priority expires leaseDuration targetRotation targetTranslation annotations maximumSpeedScale"
    # predicates: subscriptions and their messages
    " depth minimumInterval deadband secret signed deliveryState lastDelivery lastStatus failures"
    " version previousVersion eventId"
    # predicates: quantities
    " value translation displacement translationAxis velocity effort limits lowerLimit upperLimit velocityLimit"
    " effortLimit arrivalTolerance damping pose twist mass centreOfMass inertia mimic mimicsJoint multiplier offset"
    " jointState sample position positionUnit velocityUnit effortUnit orientation origin frame w linear angular"
    " ixx ixy ixz iyy iyz izz"
    # predicates: the binary frame (desideratum D5)
    " frameLayout fieldName fieldType byteOffset valueCount field byteOrder byteSize ofProperty valuePath",
)

PREFIXES: dict[str, str] = {
    "rdf": RDF.iri,
    "rdfs": RDFS.iri,
    "xsd": XSD.iri,
    "dcterms": DCTERMS.iri,
    "ldp": LDP.iri,
    "sh": SH.iri,
    "prov": PROV.iri,
    "sosa": SOSA.iri,
    "qudt": QUDT.iri,
    "unit": UNIT.iri,
    "hydra": HYDRA.iri,
    "xhv": XHV.iri,
    "hybrit": HYBRIT.iri,
    "ros": ROS.iri,
    "vom": VOM.iri,
    "maths": MATHS.iri,
    "spatial": SPATIAL.iri,
    "sd": SD.iri,
    "void": VOID.iri,
    "http-core": HTTP.iri,
    "http-methods": METHODS.iri,
    "lf": LF.iri,
}
