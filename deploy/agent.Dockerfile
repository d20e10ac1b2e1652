# The agent for a robot:   docker build -f deploy/agent.Dockerfile --target agent .
# with simulated robots:   docker build -f deploy/agent.Dockerfile --target agent-sim .
# The building machine decides on the package index: its PIP_* variables are build arguments.

# An exact version, by tag; where you deploy, give one with its digest: --build-arg PYTHON_TAG=…@sha256:…
ARG PYTHON_TAG=3.11.15-slim-bookworm

FROM python:${PYTHON_TAG} AS packages
ARG PIP_INDEX_URL
ARG PIP_EXTRA_INDEX_URL
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore
WORKDIR /build
COPY deploy/requirements-agent.txt deploy/requirements-build.txt deploy/
# Only packages whose hash is in these files are installed. "make requirements" writes them from pyproject.toml and deploy/constraints.txt.
RUN pip install -q --require-hashes -r deploy/requirements-build.txt \
 && python -m venv --without-pip /opt/linked-fleet \
 && pip --python /opt/linked-fleet/bin/python install -q --require-hashes -r deploy/requirements-agent.txt

FROM packages AS packages-sim
ARG PIP_INDEX_URL
ARG PIP_EXTRA_INDEX_URL
COPY deploy/requirements-simulation.txt deploy/
RUN pip --python /opt/linked-fleet/bin/python install -q --require-hashes -r deploy/requirements-simulation.txt

FROM packages AS built
COPY LICENSE ./
COPY agents agents
COPY deploy/bill_of_materials.py deploy/
RUN pip wheel -q --no-index --no-deps --no-build-isolation -w /build/wheels ./agents \
 && pip --python /opt/linked-fleet/bin/python install -q --no-index --no-deps /build/wheels/*.whl \
 && /opt/linked-fleet/bin/python deploy/bill_of_materials.py /opt/doc

FROM packages-sim AS built-sim
COPY LICENSE ./
COPY agents agents
COPY deploy/bill_of_materials.py deploy/
RUN pip wheel -q --no-index --no-deps --no-build-isolation -w /build/wheels ./agents \
 && pip --python /opt/linked-fleet/bin/python install -q --no-index --no-deps /build/wheels/*.whl \
 && /opt/linked-fleet/bin/python deploy/bill_of_materials.py /opt/doc

FROM python:${PYTHON_TAG} AS run
LABEL org.opencontainers.image.version="0.1.0" \
      org.opencontainers.image.licenses="Apache-2.0" \
      org.opencontainers.image.source="https://w3id.org/linked-fleet"
ENV PATH=/opt/linked-fleet/bin:$PATH PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1
COPY deploy/agent_health.py /usr/local/lib/linked-fleet/agent_health.py
USER 10001:10001
WORKDIR /tmp
HEALTHCHECK --interval=5s --timeout=5s --start-period=30s CMD ["python", "/usr/local/lib/linked-fleet/agent_health.py"]
ENTRYPOINT ["python", "-P", "-m", "linked_fleet_agent"]

FROM run AS agent-sim
LABEL org.opencontainers.image.title="Linked Fleet agent with simulated robots"
COPY --from=built-sim /opt/doc /usr/share/doc/linked-fleet
COPY --from=built-sim /opt/linked-fleet /opt/linked-fleet

FROM run AS agent
LABEL org.opencontainers.image.title="Linked Fleet agent"
COPY --from=built /opt/doc /usr/share/doc/linked-fleet
COPY --from=built /opt/linked-fleet /opt/linked-fleet
