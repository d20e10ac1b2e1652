# The gateway:   docker build -f deploy/gateway.Dockerfile .
# Where packages come from is the business of the machine: its PIP_* and NPM_CONFIG_* variables are build arguments.

FROM python:3.11-slim AS packages
ARG PIP_INDEX_URL
ARG PIP_EXTRA_INDEX_URL
ENV PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore \
    PIP_CONSTRAINT=/build/constraints.txt PIP_BUILD_CONSTRAINT=/build/constraints.txt
WORKDIR /build
COPY pyproject.toml constraints.txt ./
# An empty package first: what it needs is then fetched again only when pyproject.toml or constraints.txt change.
RUN mkdir gateway && touch gateway/__init__.py README.md LICENSE \
 && python -m venv --without-pip /opt/linked-fleet \
 && pip --python /opt/linked-fleet/bin/python install -q '.[gateway,tracing]'

# The scripts and styles of the pages; Node.js is not in the image that runs.
FROM packages AS pages
ARG PIP_INDEX_URL
ARG PIP_EXTRA_INDEX_URL
ARG NPM_CONFIG_REGISTRY
ENV NODE_EXTRA_CA_CERTS=/etc/ssl/certs/ca-certificates.crt NPM_CONFIG_CAFILE=/etc/ssl/certs/ca-certificates.crt
COPY face face
RUN mkdir -p gateway/face && face/build "$(command -v python)"

FROM packages AS built
ARG PIP_INDEX_URL
ARG PIP_EXTRA_INDEX_URL
COPY README.md LICENSE ./
COPY agents/__init__.py agents/__init__.py
COPY agents/wire agents/wire
COPY client client
COPY gateway gateway
COPY shapes shapes
COPY telemetry telemetry
COPY --from=pages /build/gateway/face/assets gateway/face/assets
COPY deploy/bill_of_materials.py deploy/
COPY face/package.json face/
RUN --mount=from=pages,source=/build/face/node_modules,target=/build/face/node_modules \
    pip --python /opt/linked-fleet/bin/python install -q --no-deps --force-reinstall . \
 && /opt/linked-fleet/bin/python deploy/bill_of_materials.py /opt/doc face

FROM python:3.11-slim AS gateway
LABEL org.opencontainers.image.title="Linked Fleet gateway" \
      org.opencontainers.image.version="0.1.0" \
      org.opencontainers.image.licenses="Apache-2.0" \
      org.opencontainers.image.source="https://w3id.org/linked-fleet"
ENV PATH=/opt/linked-fleet/bin:$PATH PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1 \
    LINKED_FLEET_STATE_DIR=/var/lib/linked-fleet
# Pinocchio is linked with OpenMP.
RUN apt-get update -qq && apt-get install -qqy --no-install-recommends libgomp1 >/dev/null && rm -rf /var/lib/apt/lists/* \
 && install -d -o 10001 -g 10001 /var/lib/linked-fleet
COPY deploy/ready.py /usr/local/lib/linked-fleet/ready.py
COPY --from=built /opt/doc /usr/share/doc/linked-fleet
COPY --from=built /opt/linked-fleet /opt/linked-fleet
USER 10001:10001
WORKDIR /tmp
EXPOSE 8000
HEALTHCHECK --interval=5s --timeout=5s --start-period=30s CMD ["python", "/usr/local/lib/linked-fleet/ready.py"]
ENTRYPOINT ["python", "-P", "-m", "gateway"]
